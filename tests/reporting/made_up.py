"""Artifacts of made-up controllers: random traces, and what the evaluation derives from them."""

import json
from pathlib import Path

import numpy as np

from pipeline.machine.chain import GROUND
from pipeline.reaching.episodes import Episodes, save_episodes
from pipeline.reaching.metrics import Traces, reaching_metrics, success_rate_matrix
from pipeline.reporting.results.controllers import TRAINED, split_name

N_EPISODES, N_TICKS = 12, 40


def random_traces(seed: int, scale: float = 1.0) -> Traces:
    """Episodes whose errors shrink to `scale` times some centimetres."""
    random = np.random.default_rng(seed)
    shrinking = np.geomspace(1.0, 0.01, N_TICKS) * random.uniform(0.3, 3.0, (N_EPISODES, 1)) * scale
    start = np.array([1.5, 0.0, 0.5])
    position = start + np.cumsum(random.normal(0.0, 0.03, (N_EPISODES, N_TICKS, 3)), axis=1)
    return Traces(
        q=random.uniform(-0.3, 0.3, (N_EPISODES, N_TICKS, 4)).astype(np.float32),
        command=random.integers(-1, 2, (N_EPISODES, N_TICKS, 4)).astype(np.float32),
        start_position=np.tile(start, (N_EPISODES, 1)).astype(np.float32),
        position=position.astype(np.float32),
        position_error=shrinking.astype(np.float32),
        pitch_error=(shrinking * random.choice([-1, 1], (N_EPISODES, 1))).astype(np.float32),
        inside=random.uniform(size=(N_EPISODES, N_TICKS)) > 0.01,
        below=random.uniform(size=(N_EPISODES, N_TICKS)) > 0.99,
        reward=random.normal(0.0, 1.0, (N_EPISODES, N_TICKS)).astype(np.float32),
    )


def write_controller(artifacts: Path, name: str, seed: int, traces: Traces, meta: dict[str, int]) -> None:
    """What the evaluation of a controller writes, and the training of a policy."""
    folder = artifacts / "evaluate_brax" / name / f"seed_{seed}"
    folder.mkdir(parents=True)
    metrics = reaching_metrics(traces, GROUND).as_dict()
    algorithm, kind = split_name(name)
    planning = {} if algorithm in TRAINED else {"planning": meta}
    (folder / "metrics.json").write_text(json.dumps(metrics | planning))
    np.savetxt(folder / "success_rates.csv", success_rate_matrix(traces), delimiter=",")
    np.savez(folder / "traces.npz", **traces._asdict())
    starts = np.zeros((N_EPISODES, 4), np.float32)
    save_episodes(
        folder / "episodes.npz", Episodes(starts, starts + np.array([0.1, 0.5, -1.5, -0.5], np.float32))
    )
    if algorithm in TRAINED:
        training = artifacts / algorithm / kind / f"seed_{seed}"
        training.mkdir(parents=True)
        (training / "meta.json").write_text(json.dumps(meta))
        rows = [{"steps": 1000 * point, **metrics} for point in range(3)]
        lines = [",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)]
        (training / "curves.csv").write_text("\n".join(lines) + "\n")
