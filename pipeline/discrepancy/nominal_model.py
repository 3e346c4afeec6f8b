"""The model that the loop is closed on, where it is not the diagnosis model itself."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.discrepancy.diagnosis.diagnosis_model import KIND
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.fit import fit
from pipeline.effects.store import ActiveEffects, load_with_effects
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def given_model(
    place: Path | None, machine: MachineSpecification
) -> tuple[tuple[DynamicsModel, Parameters] | None, ActiveEffects | None]:
    """The model in a folder and the effects around it; None and None where no folder is given.

    Raises:
        InputError: The model is of another machine, or cannot be read.
    """
    return (None, None) if place is None else load_with_effects(place, machine)


def nominal_model(
    kind: str,
    nominal: Sequence[Trajectory],
    machine: MachineSpecification,
    close_loop: CloseLoopConfig,
    identify: IdentifyConfig,
) -> tuple[DynamicsModel, Parameters] | None:
    """Identify a model; None where the diagnosis model is of the kind asked for.

    Args:
        kind: What is identified, `nfir_dqdot` for example.
        nominal: Logs of the machine that the model describes.
        close_loop: Section `close_loop`; its `baseline` says how one of the paper's kinds is trained.
        identify: Section `identify`.

    Raises:
        InputError: No such kind.
    """
    parameterization, _, target = kind.partition("_")
    try:
        parts = Parameterization(parameterization), Target(target)
    except ValueError as error:
        raise InputError(
            f"kind={kind}: not a model kind; use mlp_dq, mlp_dqdot, kan_dq, kan_dqdot or nfir_dqdot"
        ) from error
    if parts == KIND:
        return None
    result = fit(nominal, machine, *parts, close_loop.baseline, identify, close_loop.seed)
    return result.model, result.parameters
