"""Each variant's baseline model and its 4 s error on the sound machine, against which effects are sized."""

import itertools
import json
from collections.abc import Sequence
from datetime import timedelta
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.closed_loop.draw import nominal_sessions
from benchmarks.closed_loop.machines import FIRST_DAY, YARDSTICK_MINUTES, Variant
from benchmarks.closed_loop.sessions import PROFILE, Session, machine, trajectories
from pipeline.configuration.load import load_section
from pipeline.dynamics.evaluation.errors import open_loop_rmse_80
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model, save_model
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.fit import fit
from pipeline.files.atomic import write_whole
from pipeline.logs.tuples import Trajectory

MODEL_KIND = "mlp_dqdot"


class Yardstick:
    """The baseline of one variant, identified once and kept below a root folder."""

    def __init__(self, root: Path, of: Variant) -> None:
        self.variant = of
        self.model_path = root / "models" / of.name
        self._floor_path = root / "yardsticks" / f"{of.name}.json"
        if not self._floor_path.exists():
            self._identify()
        self._predictor = LearnedPredictor(*load_model(self.model_path))
        self.floor = np.array(json.loads(self._floor_path.read_text())["open_loop_rmse_80"])

    def errors(self, sessions: Sequence[Session]) -> np.ndarray:
        """4 s error of the baseline on sessions, (n_joint,), rad."""
        return open_loop_rmse_80(self._predictor, _recorded(sessions))[0]

    def _identify(self) -> None:
        """As the stage `identify` does with its default profile."""
        settings = load_section("identify", IdentifyConfig, PROFILE)
        nominal = _recorded(nominal_sessions(self.variant))
        result = fit(
            nominal,
            machine(),
            Parameterization.mlp,
            Target.dqdot,
            settings.selected[MODEL_KIND],
            settings,
            settings.seed,
        )
        lineage = {"trajectories": [trajectory.name for trajectory in nominal], "machine": machine().name}
        save_model(self.model_path, result.model, result.parameters, lineage, result.metrics, result.curves)
        unseen = _recorded(yardstick_sessions(self.variant))
        floor, n_windows = open_loop_rmse_80(LearnedPredictor(result.model, result.parameters), unseen)
        content = {"open_loop_rmse_80": floor.tolist(), "n_windows": n_windows}
        write_whole(self._floor_path, (json.dumps(content, indent=1) + "\n").encode())


@cache
def yardstick(root: Path, of: Variant) -> Yardstick:
    """The yardstick of a variant, loaded once per process."""
    return Yardstick(root, of)


def yardstick_sessions(of: Variant) -> list[Session]:
    """Nominal sessions that are in no log."""
    days = itertools.count(len(of.session_seeds))
    return [
        Session(
            of.simulator,
            of.parameters,
            (),
            of.style_seed,
            seed,
            minutes,
            FIRST_DAY + timedelta(days=day),
        )
        for seed, minutes, day in zip(of.yardstick_seeds, YARDSTICK_MINUTES, days, strict=False)
    ]


def _recorded(sessions: Sequence[Session]) -> list[Trajectory]:
    return [trajectory for session in sessions for trajectory in trajectories(session)]
