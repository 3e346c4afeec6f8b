"""Saved models for callers that use the network alone."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model_of
from pipeline.dynamics.references.all_references import References
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


def load_models(paths: Sequence[str], machine: MachineSpecification) -> dict[str, Predictor]:
    """The models by their folders' names.

    Raises:
        InputError: None is named, one cannot be used, or two have the same name.
    """
    if not paths:
        raise InputError("models is empty; name at least one model folder, models=[PATH]")
    models: dict[str, Predictor] = {}
    for path in paths:
        name = Path(path).resolve().name
        model, parameters = load_plain_model_of(Path(path), machine)
        if name in models or name in References.__dataclass_fields__:
            raise InputError(f"{path}: another predictor is called {name} already; rename the folder")
        models[name] = LearnedPredictor(model, parameters, has_stops=False)  # as the references
    return models
