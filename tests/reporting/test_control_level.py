"""The control level's table against numbers made by hand."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.reporting.tables.control_level import COLUMNS, control_level_table, load_runs

ROOT = Path(__file__).resolve().parents[2]


def write_runs(folder: Path, rates: dict[str, list[float]]) -> None:
    for model, of_model in rates.items():
        for seed, rate in enumerate(of_model):
            path = folder / model / f"seed_{seed}" / "evaluation.json"
            path.parent.mkdir(parents=True)
            path.write_text(json.dumps({"reaching": dict.fromkeys(COLUMNS, rate) | {"n_episodes": 20}}))


def test_rows_are_means_and_deviations_over_seeds(tmp_path: Path) -> None:
    rates = {"before": [0.2, 0.6], "after": [0.9, 0.95], "rich": [1.0, 1.0]}
    write_runs(tmp_path, rates)
    table = control_level_table(load_runs(tmp_path, list(rates), [0, 1]), "worn seals")
    for row, of_model in zip(table.rows, rates.values(), strict=True):
        assert row[1] == "2"
        assert set(row[2:]) == {f"{np.mean(of_model):.2f} ± {np.std(of_model, ddof=1):.2f}"}
    assert "worn seals. 20 successive targets" in table.notes[0]


def test_logs_without_targets_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "before" / "seed_0" / "evaluation.json"
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    with pytest.raises(InputError, match=r"seed_0/evaluation\.json: no sr_012_008"):
        load_runs(tmp_path, ["before"], [0])


def test_the_graph_of_the_control_level_names_stages_that_exist() -> None:
    listed = subprocess.run(
        [sys.executable, "-m", "dvc", "stage", "list", "--name-only"],
        cwd=ROOT / "experiments" / "control_level",
        capture_output=True,
        text=True,
        check=True,
    )
    names = listed.stdout.split()
    assert sum(name.startswith("drive@") for name in names) == 15
    text = (ROOT / "experiments" / "control_level" / "dvc.yaml").read_text()
    modules = {
        word.removeprefix("pipeline.stages.") for word in text.split() if word.startswith("pipeline.stages.")
    }
    assert modules
    for module in modules:
        assert (ROOT / "pipeline" / "stages" / f"{module}.py").exists()
