"""Output files of an evaluation over fixed episodes."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.files.atomic import write_json
from pipeline.reaching.episodes import Episodes, save_episodes
from pipeline.reaching.metrics import Traces, success_rate_matrix


def write_evaluation(directory: Path, metrics: Mapping[str, Any], traces: Traces, episodes: Episodes) -> None:
    """Write `metrics.json`, `episodes.npz`, `traces.npz` and `success_rates.csv`, the matrix over the thresholds."""
    directory.mkdir(parents=True, exist_ok=True)
    write_json(directory / "metrics.json", metrics)
    np.savetxt(directory / "success_rates.csv", success_rate_matrix(traces), fmt="%.4f", delimiter=",")
    save_episodes(directory / "episodes.npz", episodes)
    np.savez_compressed(directory / "traces.npz", **traces._asdict())
