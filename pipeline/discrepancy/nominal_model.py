"""The model that the loop is closed on, where it is not the diagnosis model itself."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.discrepancy.diagnosis.diagnosis_model import KIND
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.store import load_model_of
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.fit import fit
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def nominal_model(
    given: Path | None,
    kind: str,
    nominal: Sequence[Trajectory],
    machine: MachineSpecification,
    close_loop: CloseLoopConfig,
    identify: IdentifyConfig,
) -> tuple[DynamicsModel, Parameters] | None:
    """Load the model without its effects, or identify one; None where the diagnosis model is of the kind asked for.

    Args:
        given: Folder of the model; None: it is identified.
        kind: What is identified, `nfir_dqdot` for example.
        nominal: Logs of the machine that the model describes.
        machine: The machine.
        close_loop: Section `close_loop`; its `baseline` says how one of the paper's kinds is trained.
        identify: Section `identify`.

    Raises:
        InputError: The model is of another machine, or cannot be read; no such kind.
    """
    if given is not None:
        return load_model_of(given, machine)
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
