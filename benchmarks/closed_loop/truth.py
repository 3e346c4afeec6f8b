"""What a seal holds of a case."""

import json
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Onset:
    """When an effect sets in: s since the start of a measured bag."""

    trajectory: str
    t: float


@dataclass(frozen=True)
class TrueEffect:
    """One effect that was switched on.

    Attributes:
        family: Of the contract's table; of a change point it is `change_point`.
        of: The family of what set in, None if it was there from the start.
        kind: The simulator's name for it.
        joints: Affected joints.
        depends_on: As in the contract.
        parameters: The contract's names, each with `value` and `unit`.
        onset: Of a change point.
        cause: In words.
        size: Strength that it was drawn with.
        visible_size: That replays allow to be seen; None where they cannot tell, see `visibility.py`.
    """

    family: str
    of: str | None
    kind: str
    joints: tuple[str, ...]
    depends_on: tuple[str, ...]
    parameters: dict[str, dict[str, Any]]
    onset: Onset | None
    cause: str
    size: float
    visible_size: float | None = None

    @property
    def is_visible(self) -> bool:
        """Whether it is as large as can be seen, as far as replays can tell."""
        return self.visible_size is None or self.size >= self.visible_size


@dataclass(frozen=True)
class Truth:
    """A case.

    Attributes:
        number: Of the case and of its machine.
        simulator: By name, which the machine lives in.
        kind: Of the case, `kinds.in_order`.
        style: `same` or `other`: who recorded the measured sessions.
        n_joint: Of the machine.
        effects: None to three.
    """

    number: int
    simulator: str
    kind: str
    style: str
    n_joint: int
    effects: tuple[TrueEffect, ...]

    def to_json(self) -> str:
        """The seal's text."""
        return json.dumps(asdict(self), indent=1, sort_keys=True) + "\n"


def from_json(text: str) -> Truth:
    """Inverse of `Truth.to_json`."""
    return from_content(json.loads(text))


def from_content(content: dict[str, Any]) -> Truth:
    """A truth from what its JSON holds."""
    return Truth(**(content | {"effects": tuple(_effect(effect) for effect in content["effects"])}))


def _effect(content: dict[str, Any]) -> TrueEffect:
    onset = Onset(**content["onset"]) if content["onset"] is not None else None
    lists = {name: tuple(content[name]) for name in ("joints", "depends_on")}
    return TrueEffect(**(content | lists | {"onset": onset}))
