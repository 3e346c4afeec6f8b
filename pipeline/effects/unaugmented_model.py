"""Saved models for callers that use the network alone."""

from pathlib import Path

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.store import load_model_of
from pipeline.effects.store import FILE, load_effects
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification


def load_plain_model_of(directory: Path, machine: MachineSpecification) -> tuple[DynamicsModel, Parameters]:
    """Read a model folder without active effects around the network.

    Raises:
        InputError: See `load_model_of` and `load_effects`; or an effect is active, which the caller would ignore.
    """
    model, parameters = load_model_of(directory, machine)
    effects = load_effects(directory)
    if effects is not None and effects.families():
        raise InputError(
            f"{directory / FILE}: the model has effects around it ({', '.join(effects.families())}), which this stage "
            "does not apply; name one without, or identify one from logs that show them"
        )
    return model, parameters
