"""The closed loop at control level: policies of three models, tested on the machine with the effect."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.reporting.results.files import read_json
from pipeline.reporting.table import Table, mean_and_deviation

MODELS = {
    "before": "before: the model as it was",
    "after": "after: the same model with the effect that the loop found",
    "rich": "identified anew from plenty of logs with the effect",
}
COLUMNS = {
    "sr_012_008": "SR(0.12, 0.08)",
    "sr_004_004": "SR(0.04, 0.04)",
    "sr_002_002": "SR(0.02, 0.02)",
    "oow": "OOW",
    "ooz": "OOZ",
    "path_length_m": "EEF-PL [m]",
}


def load_runs(folder: Path, models: Sequence[str], seeds: Sequence[int]) -> dict[str, list[dict[str, Any]]]:
    """Results of `evaluate_logs` for each model's policies, `folder/<model>/seed_<seed>/evaluation.json`.

    Raises:
        InputError: A file is missing, or lacks reaching metrics.
    """
    runs: dict[str, list[dict[str, Any]]] = {}
    for model in models:
        runs[model] = []
        for seed in seeds:
            path = folder / model / f"seed_{seed}" / "evaluation.json"
            reaching = read_json(path).get("reaching", {})
            missing = [key for key in (*COLUMNS, "n_episodes") if key not in reaching]
            if missing:
                raise InputError(f"{path}: no {missing[0]} of reaching; evaluate logs that hold targets")
            runs[model].append(reaching)
    return runs


def control_level_table(runs: Mapping[str, Sequence[Mapping[str, Any]]], effect: str) -> Table:
    """Mean ± standard deviation over seeds.

    Args:
        runs: Results by model, one per seed; see `load_runs`.
        effect: The change of the machine, in words.
    """
    rows = [
        [MODELS.get(model, model), str(len(of_model)), *(_figure(of_model, key) for key in COLUMNS)]
        for model, of_model in runs.items()
    ]
    n_targets = sorted({int(run["n_episodes"]) for of_model in runs.values() for run in of_model})
    counts = " to ".join(str(n) for n in dict.fromkeys((n_targets[0], n_targets[-1])))
    return Table(
        "Policies on the simulated machine that has the effect",
        ["Policies learned on", "Seeds", *COLUMNS.values()],
        rows,
        [
            f"The machine: {effect}. {counts} successive targets per policy, the same for all, through the graph "
            "with its measured delays; safety stops and the end at the goal are off.",
            "Mean ± standard deviation over seeds. SR(p, α): share of targets within p m and α rad at one tick at "
            "least.",
        ],
    )


def _figure(runs: Sequence[Mapping[str, Any]], key: str) -> str:
    return mean_and_deviation([float(run[key]) for run in runs])
