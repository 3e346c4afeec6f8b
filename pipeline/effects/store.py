"""An augmented model's folder: the frozen model's files and `effects.json`.

`effects.json` holds `setting` (`dt_s` and, per joint, `lower`, `upper` and `speed_scale`; of a dependence on a channel
also `channels`, each `name`, `lower`, `upper` and `usual` in its own unit, and `kept`), `values` (by family and
parameter, one row per joint), `deviations` (standard deviations of values, in the same form) and `onset_ns` (by family
one absolute stamp per joint, null if it acts all the time). Older files hold one stamp per family, valid for all
joints, and no deviations.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics import Dynamics
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import load_model, load_model_of, model_fingerprint
from pipeline.effects.augmented_model import AugmentedModel, AugmentedParameters
from pipeline.effects.catalogue import IN_MODELS
from pipeline.effects.chain import Chain
from pipeline.effects.effect import Channel, Setting
from pipeline.effects.predictor import AugmentedPredictor, Onsets
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.machine.specification import MachineSpecification

SCHEMA_VERSION = 1
FILE = "effects.json"


@dataclass(frozen=True)
class ActiveEffects:
    """Effects with their values.

    Attributes:
        setting: Properties of the machine.
        values: By family and parameter, (n_joint, ...).
        onset_ns: Absolute stamp of the onset by family and joint index, if it set in within the logs. On joints without
            an onset the effect acts all the time.
        deviations: Standard deviations of values, by family and parameter, in their shapes; what is missing is 0.
    """

    setting: Setting
    values: Mapping[str, Mapping[str, np.ndarray]]
    onset_ns: Onsets
    deviations: Mapping[str, Mapping[str, np.ndarray]] = field(default_factory=dict)

    def families(self) -> list[str]:
        """Families with a value that is not neutral."""
        active = []
        for family, of in self.values.items():
            neutral = IN_MODELS[family](self.setting).neutral()
            if any(np.any(np.asarray(value) != neutral[name]) for name, value in of.items()):
                active.append(family)
        return active

    def chain(self, families: Sequence[str]) -> Chain:
        """The chain of the families named."""
        return Chain([IN_MODELS[family] for family in families], self.setting)


def predictor(model: DynamicsModel, parameters: Parameters, effects: ActiveEffects | None) -> Predictor:
    """The model with its effects; the frozen model itself if no effect is active."""
    families = effects.families() if effects is not None else []
    if effects is None or not families:
        return LearnedPredictor(model, parameters)
    return augmented(model, parameters, effects)


def augmented(model: DynamicsModel, parameters: Parameters, effects: ActiveEffects) -> AugmentedPredictor:
    """The model with its active effects."""
    families = effects.families()
    values = {family: effects.values[family] for family in families}
    onset_ns = {family: of for family, of in effects.onset_ns.items() if family in families}
    return AugmentedPredictor(model, parameters, effects.chain(families), values, onset_ns)


def save_effects(directory: Path, effects: ActiveEffects) -> None:
    """Write `effects.json` beside a saved model."""
    content = {
        "schema_version": SCHEMA_VERSION,
        "setting": {
            "dt_s": effects.setting.dt_s,
            **{name: getattr(effects.setting, name).tolist() for name in ("lower", "upper", "speed_scale")},
            **(
                {"channels": [c._asdict() for c in channels]}
                if (channels := effects.setting.channels)
                else {}
            ),
        },
        "values": _lists(effects.values),
        **({"deviations": _lists(effects.deviations)} if effects.deviations else {}),
        "onset_ns": {
            family: [int(of[joint]) if joint in of else None for joint in range(effects.setting.n_joint)]
            for family, of in effects.onset_ns.items()
        },
    }
    write_json(directory / FILE, content, sort_keys=True)


def load_effects(directory: Path) -> ActiveEffects | None:
    """Read `effects.json`; None if it is missing.

    Raises:
        InputError: The file is damaged, of another version, or names an unknown effect.
    """
    path = directory / FILE
    if not path.exists():
        return None
    try:
        content: dict[str, Any] = json.loads(path.read_text())
        version = content["schema_version"]
        if version != SCHEMA_VERSION:
            raise InputError(
                f"{path}: schema version {version}, this program reads {SCHEMA_VERSION}; close the loop again"
            )
        limits = [_numbers(content["setting"][name]) for name in ("lower", "upper", "speed_scale")]
        channels = _channels(content["setting"].get("channels", []))
        setting = Setting(float(content["setting"]["dt_s"]), limits[0], limits[1], limits[2], channels)
        values, deviations = _arrays(content["values"]), _arrays(content.get("deviations", {}))
        onset_ns = {family: _onsets(of, setting.n_joint) for family, of in content["onset_ns"].items()}
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        ArithmeticError,
        RecursionError,
    ) as error:
        raise InputError(f"{path}: not readable as effects ({error}); close the loop again") from error
    effects = ActiveEffects(setting, values, onset_ns, deviations)
    fault = _fault(effects)
    if fault:
        raise InputError(f"{path}: {fault}; close the loop again with this version")
    return effects


def load_active(directory: Path) -> ActiveEffects | None:
    """Read `effects.json`; None if it is missing, or no effect in it is active. Raises as `load_effects`."""
    return _active(load_effects(directory))


def _active(effects: ActiveEffects | None) -> ActiveEffects | None:
    return effects if effects is not None and effects.families() else None


def _lists(by_family: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, dict[str, list]]:
    return {
        family: {name: np.asarray(value).tolist() for name, value in of.items()}
        for family, of in by_family.items()
    }


def _arrays(by_family: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, np.ndarray]]:
    return {family: {name: _numbers(value) for name, value in of.items()} for family, of in by_family.items()}


def _numbers(value: Any) -> np.ndarray:
    numbers = np.asarray(value, np.float64)
    if not np.all(np.isfinite(numbers)):
        raise ValueError("a value is not finite")
    return numbers


def _channels(content: Any) -> tuple[Channel, ...]:
    return tuple(
        Channel(str(of["name"]), *_numbers([of[name] for name in Channel._fields[1:]]).tolist())
        for of in content
    )


def _onsets(of: Any, n_joint: int) -> dict[int, int]:
    """Onsets by joint; one stamp, as in older files, applies to all joints."""
    stamps = of if isinstance(of, list) else [of] * n_joint
    if len(stamps) != n_joint:
        raise ValueError(f"{len(stamps)} onsets of {n_joint} joints")
    return {joint: int(stamp) for joint, stamp in enumerate(stamps) if stamp is not None}


def _fault(effects: ActiveEffects) -> str | None:
    """What is wrong with the effects, in a clause; None if nothing is."""
    setting = effects.setting
    if {setting.lower.shape, setting.upper.shape, setting.speed_scale.shape} != {(setting.lower.size,)}:
        return "the setting's limits and speeds are not one number per joint"
    if not (0.0 < setting.dt_s < np.inf and np.all(setting.speed_scale > 0.0)):
        return "the setting's time step or a speed is not positive"
    if not np.all(setting.lower < setting.upper):
        return "a joint's lower limit is not below its upper limit"
    unknown = [family for family in effects.values if family not in IN_MODELS]
    if unknown:
        return f"unknown effects {', '.join(unknown)}"
    for family, of in effects.values.items():
        expected = {name: value.shape for name, value in IN_MODELS[family](setting).neutral().items()}
        if {name: value.shape for name, value in of.items()} != expected:
            return f"the values of {family} are not {', '.join(expected)} with one row per joint"
    for family, of in effects.deviations.items():
        shapes = {name: np.shape(value) for name, value in effects.values.get(family, {}).items()}
        if any(value.shape != shapes.get(name) or np.any(value < 0.0) for name, value in of.items()):
            return f"the deviations of {family} are not those of its values"
    without = [family for family in effects.onset_ns if family not in effects.values]
    return f"an onset of {', '.join(without)}, which has no values" if without else None


def load_predictor(
    directory: Path, all_set_in: bool = False, machine: MachineSpecification | None = None
) -> Predictor:
    """Read a model folder of `identify` or `close_loop` as a predictor.

    Args:
        all_set_in: Whether effects act from the first row on, regardless of their onsets.
        machine: Required machine of the model; None accepts any.

    Raises:
        InputError: see `load_model` and `load_effects`; or the effects belong to another machine than the model, or
            the model to another than `machine`.
    """
    (model, parameters), effects = load_with_effects(directory, machine)
    if effects is not None and all_set_in:
        effects = replace(effects, onset_ns={})
    return predictor(model, parameters, effects)


def load_dynamics(directory: Path, machine: MachineSpecification | None = None) -> tuple[Dynamics, Any]:
    """Read a model folder of `identify` or `close_loop` as dynamics for control, with all effects set in.

    Args:
        machine: Required machine of the model; None accepts any.

    Returns:
        The model and its parameters: the frozen ones if no effect is active.

    Raises:
        InputError: see `load_predictor`.
    """
    (model, parameters), effects = load_with_effects(directory, machine)
    if effects is None:
        return model, parameters
    families = effects.families()
    values = {
        family: {name: jnp.asarray(value, jnp.float32) for name, value in effects.values[family].items()}
        for family in families
    }
    return AugmentedModel(model, effects.chain(families)), AugmentedParameters(parameters, values)


def dynamics_fingerprint(directory: Path) -> str:
    """Digest of the network's parameters and of the effects around it.

    Raises:
        InputError: see `load_model`.
    """
    network = model_fingerprint(directory)
    path = directory / FILE
    return network if not path.exists() else hashlib.sha256(network.encode() + path.read_bytes()).hexdigest()


def load_with_effects(
    directory: Path, machine: MachineSpecification | None = None
) -> tuple[tuple[DynamicsModel, Parameters], ActiveEffects | None]:
    """Read the frozen model and θ of a folder, and the effects around it; None if none is active.

    Raises:
        InputError: see `load_predictor`.
    """
    model, parameters = load_model(directory) if machine is None else load_model_of(directory, machine)
    effects = load_effects(directory)
    expected = (model.specification.n_joint, model.specification.dt_s)
    if effects is not None and not np.allclose((effects.setting.n_joint, effects.setting.dt_s), expected):
        raise InputError(
            f"{directory / FILE}: effects of {effects.setting.n_joint} joints at steps of {effects.setting.dt_s} s, "
            f"the model has {expected[0]} joints and steps of {expected[1]} s; close the loop again"
        )
    return (model, parameters), _active(effects)
