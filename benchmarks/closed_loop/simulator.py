"""What the benchmark needs of a simulator. Which ones there are stands in `simulators.py`."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.recording.session import SessionLog

if TYPE_CHECKING:
    from benchmarks.closed_loop.machines import Variant

Machine = Any
"""All quantities of one machine, as a simulator describes it; nobody else looks into it."""

MACHINE = "bobcat_e10"
"""Whose joints a simulator has that does not draw them."""


class Quantity(Protocol):
    """A number with its unit, as in the contract's `parameters`."""

    @property
    def value(self) -> float:
        """In that unit."""
        ...

    @property
    def unit(self) -> str:
        """SI; `1` for ratios, `sign` for directions."""
        ...


class Effect(Protocol):
    """One change of a machine."""

    @property
    def family(self) -> str:
        """Of the contract's table; `other` where none describes it."""
        ...

    @property
    def kind(self) -> str:
        """The simulator's name for it."""
        ...

    @property
    def joints(self) -> tuple[str, ...]:
        """Affected ones."""
        ...

    @property
    def depends_on(self) -> tuple[str, ...]:
        """As in the contract."""
        ...

    @property
    def truth(self) -> Mapping[str, Quantity]:
        """The contract's parameters where it defines them, and more beside them."""
        ...

    @property
    def cause(self) -> str:
        """What happened to the machine, in words."""
        ...

    @property
    def apply(self) -> Any:
        """(machine) -> the changed machine."""
        ...


class Simulator(ABC):
    """Machines, the effects that can befall them, and sessions with them."""

    name: str
    """As `generate --simulator` takes it and as seals state it."""

    variant_name: str
    """What folders of its variants begin with."""

    entropy: tuple[int, ...]
    """Joins every seed that cases and variants are drawn with, so that no two simulators draw alike."""

    outside: tuple[str, ...]
    """Its kinds that no family of the contract describes; it has a kind for each family by that family's name."""

    largest_size: Mapping[str, float]
    """Physical bound of each kind's size."""

    def specification(self, machine: Machine) -> MachineSpecification:
        """Joints, limits and rate of a machine."""
        return load_machine(MACHINE)

    @abstractmethod
    def drawn_machine(self, seed: int) -> Machine:
        """A machine of the class, sound, of which every constant is drawn by seed."""

    @abstractmethod
    def draw_effect(self, kind: str, seed: int, variant: "Variant", size: float) -> Effect:
        """An effect.

        Args:
            kind: A family, or one of `outside`.
            seed: Of joint, direction and strength.
            variant: That it will befall.
            size: Strength, 1 for a typical one.
        """

    @abstractmethod
    def record(
        self,
        machine: Machine,
        changes: Sequence[tuple[float, Machine]],
        style_seed: int,
        minutes: float,
        seed: int,
        start_time_ns: int,
    ) -> SessionLog:
        """Let an operator work.

        Args:
            machine: At the start.
            changes: Later ones, each with the time from which on it holds, s; ascending.
            style_seed: Of the operator's habits.
            minutes: Duration.
            seed: Of the session's chances.
            start_time_ns: Absolute time of the start.
        """

    @abstractmethod
    def replay(
        self,
        machine: Machine,
        log: SessionLog,
        session_seed: int,
        starts: Sequence[int],
        horizon: int,
        seed: int,
        changes: Sequence[tuple[float, Machine]] = (),
        instead: Sequence[Machine | None] = (None,),
    ) -> np.ndarray:
        """Let stretches of a session happen again: the same state and commands, other chances.

        Args:
            machine: That was recorded.
            log: The session.
            session_seed: That it was recorded with.
            starts: Control periods with which the stretches begin, ascending.
            horizon: Control periods of each.
            seed: Of the new chances.
            changes: Later machines that were recorded.
            instead: One replay each: what takes the machine's place as a stretch begins; None: nothing does.

        Returns:
            (n_replay, n_starts, horizon, n_joint) true displacements from each stretch's start, rad or m.
        """
