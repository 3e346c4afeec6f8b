"""What an effect is: a card that a control engineer can read, and a differentiable wrapper around any f_θ.

The augmented model (`augmented_model.py`) is a chain. Commands pass the command effects, the frozen f_θ turns them into
the velocity u that the nominal machine would have, velocity effects turn u into the machine's velocity v, and a
sensor effect maps the true configuration to the measured one:

    a → [command effects] → f_θ → u → [speed → response → drift → play] → v → ∫ → q → [sensor] → measured q

Each link has state of its own, works on any leading batch axes and equals the identity at its neutral parameters.
Velocity effects also have an inverse: measured velocities are mapped back to those of the nominal machine, on which
f_θ was learned, before they enter its window.
"""

import enum
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

# A card's lengths are those of a joint with at least this range, rad (none of the machines that they were chosen on
# has less); on one with less, as a cylinder's stroke in metres, they are smaller in proportion.
CARDS_RANGE = 1.5

Values = Mapping[str, jax.Array]
State = Any
Freed = tuple[
    tuple[str, int | tuple[int, ...] | None], ...
]  # parameters, with their source, that move together
Variant = tuple[Freed, ...]


class Place(enum.IntEnum):
    """Where in the chain an effect acts; effects of equal place act in the order of their families' names."""

    command_size = 0  # before delays, which interpolate between commands
    command = 1
    speed = 2
    response = 3
    drift = 4
    play = 5
    sensor = 6


class Scope(enum.StrEnum):
    """Which joints an effect of the family can act on."""

    joint = "joint"  # any joint by itself
    machine = "machine"  # several joints at once, with parameters in common


class Abscissa(enum.Enum):
    """What the residual is drawn over, for a reader to see an effect."""

    position = enum.auto()  # of the joint, or of the joint that it depends on
    time = enum.auto()  # since the log's start
    other_commands = enum.auto()  # how many joints are commanded besides this one
    command = enum.auto()  # of the joint, or of the joint that it depends on
    since_command = enum.auto()  # time since the joint's command last changed
    velocity = enum.auto()  # that the model predicts


class Along(enum.Enum):
    """Which way the residual is counted there, so that starts and stops, or both directions, do not cancel."""

    axis = enum.auto()  # as the joint's velocity is
    motion = enum.auto()  # along the motion that the model predicts: negative is slower than it
    change = enum.auto()  # along the last change of the joint's command: negative is later than the model


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, an array with one value per joint.

    Attributes:
        name: As in the contract (section 4) where it has one.
        unit: `1`, `s`, `Hz`, `sign`, `length` (rad or m) or `speed` (rad/s or m/s).
        neutral: The value at which the effect is the identity.
        lower: Smallest plausible value; a length's is of a joint of the cards' range (`Effect.sizes`).
        upper: Largest plausible value, likewise.
        grid: Values that the search tries, likewise; none: the model is linear in it, least squares finds it.
        per_source: Whether the value is a row with one entry per joint (sources).
        natural_bounds: Whether nothing lies beyond the bounds (no speed at all), so that a value there is none that
            hides another cause.
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    grid: tuple[float, ...] = ()
    per_source: bool = False
    natural_bounds: bool = False


@dataclass(frozen=True)
class Card:
    """What there is to know about a family of effects.

    Attributes:
        family: As in the contract.
        equation: In the terms of this package.
        source: Publication or section that the equation is from.
        signature: What it leaves in the residual.
        confounded_with: Families that can look alike.
        excitation: The manoeuvre that shows it.
        depends_on: Variables (contract, section 4) that the residual depends on; `{joint}` is filled in.
        scope: Which joints it can act on.
        complexity: How much it can fit, from 1 (a gain) to 5 (any dependence on a variable): of what explains the logs
            equally well, the simplest is taken.
        drawn_over: What its signature is drawn over.
        counted_along: Which way the residual is counted in that drawing.
        parameters: Of the wrapper.
        can_set_in: Whether a moment at which it sets in is looked for.
    """

    family: str
    equation: str
    source: str
    signature: str
    confounded_with: tuple[str, ...]
    excitation: str
    depends_on: tuple[str, ...]
    scope: Scope
    complexity: float
    drawn_over: Abscissa
    counted_along: Along
    parameters: tuple[Parameter, ...]
    can_set_in: bool = True


@dataclass(frozen=True)
class Setting:
    """What effects know of the machine.

    Attributes:
        dt_s: Length of one time step.
        lower: (n_joint,) lower joint limits, rad or m.
        upper: (n_joint,) upper joint limits.
        speed_scale: (n_joint,) a joint's usual full speed, rad/s or m/s.
    """

    dt_s: float
    lower: np.ndarray
    upper: np.ndarray
    speed_scale: np.ndarray

    @property
    def n_joint(self) -> int:
        """Number of joints."""
        return len(self.lower)


class Signals(NamedTuple):
    """What an effect sees at one time step; leading batch axes (...).

    Attributes:
        command: (..., n_joint), a_t.
        q: (..., n_joint), the true configuration, rad or m.
        time_s: (...,), since the start of the log.
    """

    command: jax.Array
    q: jax.Array
    time_s: jax.Array


class Effect(ABC):
    """A family's wrapper. Arrays of parameters have shape (n_joint,), or (n_joint, n_joint) per source.

    Attributes:
        needs_proportional_commands: Whether it is the identity on commands in {-1, 0, 1}.
        reaches_other_joints: Whether, acting on one joint, it changes others' speeds by more than next to nothing.
        of_the_machine: Parameters on the grid whose value is one for all joints that have the effect.
        parsimony: Share of what a variant explains, by which one with more parameters has to explain more.
    """

    card: ClassVar[Card]
    place: ClassVar[Place]
    of_the_machine: ClassVar[tuple[str, ...]] = ()
    parsimony: ClassVar[float] = 0.03
    needs_proportional_commands: ClassVar[bool] = False
    reaches_other_joints: ClassVar[bool] = False

    def __init__(self, setting: Setting) -> None:
        self.setting = setting

    def neutral(self) -> dict[str, np.ndarray]:
        """Parameters at which the effect is the identity."""
        n = self.setting.n_joint
        return {
            parameter.name: np.full((n, n) if parameter.per_source else (n,), parameter.neutral)
            for parameter in self.card.parameters
        }

    def grid(self) -> list[dict[str, float]]:
        """Points that the search tries of the parameters that the model is not linear in: all combinations.

        Lengths are those of a joint of the cards' range.
        """
        tried = [parameter for parameter in self.card.parameters if parameter.grid]
        names = [parameter.name for parameter in tried]
        return [
            dict(zip(names, point, strict=True))
            for point in product(*(parameter.grid for parameter in tried))
        ]

    def sizes(self, name: str) -> np.ndarray:
        """(n_joint,) what the grid and the bounds of a parameter are multiplied by on each joint."""
        units = {parameter.name: parameter.unit for parameter in self.card.parameters}
        if units[name] != "length":
            return np.ones(self.setting.n_joint)
        return np.minimum((self.setting.upper - self.setting.lower) / CARDS_RANGE, 1.0)

    def variants(self) -> list[Variant]:
        """Ways to free the parameters that the model is linear in: by default all of them, each by itself."""
        sources: list[Freed] = []
        for parameter in self.card.parameters:
            if not parameter.grid:
                indices = range(self.setting.n_joint) if parameter.per_source else [None]
                sources += [((parameter.name, index),) for index in indices]
        return [tuple(sources)]

    def freed_later(self) -> Variant:
        """Parameters that belong to the effect but do not make it known: fitted only once it has been found."""
        return ()

    def fitted_later(self) -> dict[str, float]:
        """As `freed_later`, of parameters that the effect is not linear in: where their fit begins."""
        return {}

    def freed_beside_nominal(self) -> Variant:
        """Parameters that belong to the effect where nominal logs have it, too: of what f_θ has of it."""
        return ()

    def initial(self, batch: tuple[int, ...]) -> State:
        """State of a machine that has been at rest."""
        return ()

    def _zeros(self, batch: tuple[int, ...]) -> jax.Array:
        return jnp.zeros((*batch, self.setting.n_joint))


class CommandEffect(Effect):
    """Changes the commands before f_θ sees them."""

    place = Place.command

    @abstractmethod
    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """One step: commands in, commands out, (..., n_joint)."""


class VelocityEffect(Effect):
    """Changes the velocity of the nominal machine."""

    @abstractmethod
    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One step forward: velocity in, velocity out, (..., n_joint)."""

    @abstractmethod
    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One step of measured velocities back to those that came in; keeps the state up to date."""

    def ahead(self, values: Values, state: State) -> jax.Array | None:
        """How far the frozen model's joint lies ahead of what moves, (..., n_joint), rad or m; None: not at all.

        Stops and places are the frozen model's joint's.
        """
        return None


class RatioEffect(VelocityEffect):
    """Multiplies the velocity: v = ratio · u.

    Attributes:
        passes: Fixed-point passes of the inverse: more than one where the ratio depends on the size of u.
    """

    place = Place.speed
    passes: ClassVar[int] = 1

    @abstractmethod
    def ratio(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """The ratio at one step, (..., n_joint)."""

    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Multiply by the ratio."""
        state, ratio = self.ratio(values, state, u, signals)
        return state, ratio * u

    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """Divide by the ratio; it is first taken at v, which has the sign of u, and then at what that gives for u."""
        u = v
        for _ in range(self.passes):
            after, ratio = self.ratio(values, state, u, signals)
            u = v / jnp.maximum(ratio, SMALLEST_RATIO)
        return after, u


class SensorEffect(Effect):
    """Changes what is measured of the configuration."""

    place = Place.sensor

    @abstractmethod
    def measured(self, values: Values, q: jax.Array) -> jax.Array:
        """True to measured configuration."""

    @abstractmethod
    def true(self, values: Values, q: jax.Array) -> jax.Array:
        """Measured to true configuration."""


SMALLEST_COMMAND = 1e-3  # a smaller one is none
SMALLEST_RATIO = 0.05  # slower than this, a measured velocity says nothing about the nominal machine's


def direction_weights(u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Masks of positive and negative motion."""
    return (u > 0).astype(u.dtype), (u < 0).astype(u.dtype)
