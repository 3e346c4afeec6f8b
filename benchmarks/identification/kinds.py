"""The kinds of models that are compared: each is fitted to trajectories and then predicts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from omegaconf import OmegaConf

from benchmarks.identification.gaussian_process import fit_gaussian_process
from benchmarks.identification.ridge import fit_ridge
from pipeline.configuration.load import load_section
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.evaluation.predictive_band import PredictiveBand
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.references.all_references import ArxConfig
from pipeline.dynamics.references.arx import fit_arx
from pipeline.dynamics.references.grey_box import GreyBoxConfig, fit_grey_box
from pipeline.dynamics.references.narx import NarxConfig, fit_narx
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.fit import fit
from pipeline.errors import InputError, first_line
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

PROFILE = "default"
SEPARATOR = ":"  # of a kind and the settings that differ from the profile's

Fit = Callable[[Sequence[Trajectory], MachineSpecification, int], Predictor]
"""(trajectories with their split, machine, seed) -> predictor."""


@dataclass(frozen=True)
class Stopped:
    """A reference whose joints end where `LearnedPredictor`'s do: at the limits, or as far as they were seen."""

    inner: Predictor
    machine: MachineSpecification

    @property
    def rows_before(self) -> int:
        """See `Predictor`."""
        return self.inner.rows_before

    def predict(self, trajectory: Trajectory, starts: np.ndarray, horizon: int) -> np.ndarray:
        """See `Predictor`."""
        q = trajectory.q[starts]
        lower = np.minimum(self.machine.lower, np.fmin.accumulate(trajectory.q)[starts])
        upper = np.maximum(self.machine.upper, np.fmax.accumulate(trajectory.q)[starts])
        free = self.inner.predict(trajectory, starts, horizon)
        steps = np.diff(free, axis=1, prepend=q[:, None])
        for step in range(horizon):
            free[:, step] = q = np.clip(q + steps[:, step], lower, upper)
        return free


class EnsemblePredictor(LearnedPredictor):
    """A learned predictor that can say how sure it is."""

    def __init__(self, model: FirModel, parameters: Parameters, learning: Sequence[Trajectory]) -> None:
        super().__init__(model, parameters)
        self.band = partial(PredictiveBand, model, parameters, learning)


def _network(name: str) -> Fit:
    """A kind of network as the profile trains it, or with other settings: `<kind>:<setting>=<value>:…`."""
    kind, *changes = name.split(SEPARATOR)
    settings = load_section("identify", IdentifyConfig, PROFILE)
    try:
        training = replace(
            settings.training_of(kind), **OmegaConf.to_container(OmegaConf.from_dotlist(changes))
        )
    except TypeError as error:
        raise InputError(f"{name}: {first_line(error)}; give settings of identify.selected") from error
    parameterization, _, target = kind.partition("_")
    parts = Parameterization(parameterization), Target(target)

    def fit_network(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> Predictor:
        found = fit(learning, machine, *parts, training, settings, seed)
        if isinstance(found.model, FirModel):
            return EnsemblePredictor(found.model, found.parameters, learning)
        return LearnedPredictor(found.model, found.parameters)

    return fit_network


def _arx(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> Predictor:
    arx = load_section("judge.arx", ArxConfig, PROFILE)
    return Stopped(fit_arx(learning, Target.dqdot, arx.lags, machine.dt_s, arx.ridge), machine)


def _ridge(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> Predictor:
    return Stopped(fit_ridge(learning, machine, seed), machine)


def _narx(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> Predictor:
    return Stopped(fit_narx(learning, load_section("judge.narx", NarxConfig, PROFILE), machine.dt_s), machine)


def _grey_box(learning: Sequence[Trajectory], machine: MachineSpecification, seed: int) -> Predictor:
    grey_box = load_section("judge.grey_box", GreyBoxConfig, PROFILE)
    return Stopped(fit_grey_box(learning, grey_box, machine.dt_s), machine)


REFERENCES: dict[str, Fit] = {"ridge": _ridge, "arx": _arx, "narx": _narx, "grey_box": _grey_box}
GAUSSIAN_PROCESS = "gaussian_process"  # needs a Python that has GPJax


def fits_of(names: Sequence[str], gp_python: str | None) -> dict[str, Fit]:
    """The fit of each of these kinds.

    Raises:
        InputError: There is no such kind or setting.
    """
    known = dict(REFERENCES)
    if gp_python is not None:
        known[GAUSSIAN_PROCESS] = fit_gaussian_process(gp_python)
    return {name: known.get(name) or _network(name) for name in names}
