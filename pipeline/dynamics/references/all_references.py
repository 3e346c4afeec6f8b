"""The references, fitted on the models' training rows."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.references.arx import ArxPredictor, fit_arx
from pipeline.dynamics.references.grey_box import GreyBoxConfig, GreyBoxPredictor, fit_grey_box
from pipeline.dynamics.references.narx import NarxConfig, NarxPredictor, fit_narx
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass
class ArxConfig:
    """The linear references.

    Attributes:
        lags: k, as in the models.
        ridge: Penalty on the squared weights of the standardised inputs, per row.
    """

    lags: int
    ridge: float

    def __post_init__(self) -> None:
        if self.lags < 0:
            raise InputError(f"judge.arx.lags is {self.lags}; it must not be negative")
        if not self.ridge >= 0:
            raise InputError(f"judge.arx.ridge is {self.ridge}; it must not be negative")


@dataclass(frozen=True)
class References:
    """Fitted references.

    Attributes:
        arx_dq: Linear ARX that predicts displacements.
        arx_dqdot: Linear ARX that predicts velocity increments.
        narx: Polynomial NARX with selected terms.
        grey_box: Dead time, lag and gain per direction.
    """

    arx_dq: ArxPredictor
    arx_dqdot: ArxPredictor
    narx: NarxPredictor
    grey_box: GreyBoxPredictor


def fit_references(
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    arx: ArxConfig,
    narx: NarxConfig,
    grey_box: GreyBoxConfig,
) -> References:
    """Fit all references to the training rows.

    Raises:
        InputError: if there are too few rows.
    """
    return References(
        arx_dq=fit_arx(trajectories, Target.dq, arx.lags, machine.dt_s, arx.ridge),
        arx_dqdot=fit_arx(trajectories, Target.dqdot, arx.lags, machine.dt_s, arx.ridge),
        narx=fit_narx(trajectories, narx, machine.dt_s),
        grey_box=fit_grey_box(trajectories, grey_box, machine.dt_s),
    )
