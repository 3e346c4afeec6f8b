"""4 s errors of a solution's two models on the logs that nobody was shown."""

import json
from pathlib import Path

from benchmarks.closed_loop.sessions import ingest_settings
from pipeline.dynamics.evaluation.errors import Predictor, open_loop_rmse_80
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model
from pipeline.files.atomic import write_whole
from pipeline.logs.trajectories import load_trajectories
from pipeline.machine.specification import MachineSpecification

MODELS = {"before": "model_before", "after": "model_after"}


def examine(exam_logs: Path, machine: MachineSpecification, solution: Path, output: Path) -> None:
    """Write `{"before": {joint: rad}, "after": …}` of the models in `solution`.

    Raises:
        InputError: A model or a log cannot be used.
    """
    logs = load_trajectories(exam_logs, machine, *ingest_settings())
    errors = {}
    for name, folder in MODELS.items():
        rmse, _ = open_loop_rmse_80(load_predictor(solution / folder), logs)
        errors[name] = dict(zip(machine.joint_names, rmse.tolist(), strict=True))
    write_whole(output, (json.dumps(errors, indent=1) + "\n").encode())


def load_predictor(path: Path) -> Predictor:
    """A model with or without effects added."""
    try:
        from pipeline.effects.store import load_predictor as load_with_effects
    except ImportError:
        return LearnedPredictor(*load_model(path))
    return load_with_effects(path)
