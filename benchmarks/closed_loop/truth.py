"""What a seal holds of a case."""

import json
from dataclasses import asdict, dataclass
from typing import Any

from benchmarks.closed_loop.simulator import PLANT


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
        wanted_ratio: Of the 4 s error of affected joints with and without it; None where it was not calibrated.
        ratio: What was reached.
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
    wanted_ratio: float | None
    ratio: float | None


@dataclass(frozen=True)
class Truth:
    """A case.

    Attributes:
        seed: That it was drawn by.
        kind: Of the case, `kinds.in_order`.
        variant: Number of the machine.
        style: `same` or `other`: who recorded the measured sessions.
        effects: None, one or two.
        simulator: By name, which the machine lives in.
    """

    seed: int
    kind: str
    variant: int
    style: str
    effects: tuple[TrueEffect, ...]
    simulator: str = PLANT

    def to_content(self) -> dict[str, Any]:
        """What the JSON holds. No simulator means the plant, as in seals from before there was another."""
        content = asdict(self)
        if self.simulator == PLANT:
            del content["simulator"]
        return content

    def to_json(self) -> str:
        """The seal's text."""
        return json.dumps(self.to_content(), indent=1, sort_keys=True) + "\n"


def from_json(text: str) -> Truth:
    """Inverse of `Truth.to_json`."""
    return from_content(json.loads(text))


def from_content(content: dict[str, Any]) -> Truth:
    """Inverse of `Truth.to_content`."""
    return Truth(**(content | {"effects": tuple(_effect(effect) for effect in content["effects"])}))


def _effect(content: dict[str, Any]) -> TrueEffect:
    onset = Onset(**content["onset"]) if content["onset"] is not None else None
    lists = {name: tuple(content[name]) for name in ("joints", "depends_on")}
    return TrueEffect(**(content | lists | {"onset": onset}))
