"""The interface of effects: a descriptive card, and a differentiable wrapper around any f_θ.

The augmented model (`augmented_model.py`) is a chain. Commands pass the command effects, the frozen f_θ turns them into
the velocity u that the nominal machine would have, velocity effects turn u into the machine's velocity v, and a
sensor effect maps the true configuration to the measured one:

    a → [command effects] → f_θ → u → [speed → response → drift → play] → v → ∫ → q → [sensor] → measured q

Each link has its own state, works on any leading batch axes and is the identity at its neutral parameters.
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

# A card's lengths hold for a joint with at least this range, rad. For a smaller range, such as a cylinder's stroke in
# metres, they are scaled in proportion.
REFERENCE_RANGE = 1.5

Values = Mapping[str, jax.Array]
State = Any
Freed = tuple[
    tuple[str, int | tuple[int, ...] | None], ...
]  # parameters, with their source, that are varied together
Variant = tuple[Freed, ...]


class Place(enum.IntEnum):
    """Position of an effect in the chain; effects of equal position act in the order of their families' names."""

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
    machine = "machine"  # several joints at once, with common parameters


class Abscissa(enum.Enum):
    """Abscissa of the drawing that shows an effect in the residual."""

    position = enum.auto()  # of the joint, or of the joint that it depends on
    time = enum.auto()  # since the log's start
    other_commands = enum.auto()  # how many joints are commanded besides this one
    command = enum.auto()  # of the joint, or of the joint that it depends on
    since_command = enum.auto()  # time since the joint's command last changed
    velocity = enum.auto()  # predicted by the model
    channel = enum.auto()  # that it depends on


class Along(enum.Enum):
    """Sign convention of the drawn residual, so that starts and stops, or both directions, do not cancel."""

    axis = enum.auto()  # sign of the joint's axis
    motion = enum.auto()  # along the predicted motion: negative is slower
    change = enum.auto()  # along the last change of the joint's command: negative is later


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect, an array with one value per joint.

    Attributes:
        name: Name in the contract (section 4), if it has one.
        unit: `1`, `s`, `Hz`, `sign`, `length` (rad or m) or `speed` (rad/s or m/s).
        neutral: The value at which the effect is the identity.
        lower: Smallest plausible value; lengths are for a joint of `REFERENCE_RANGE` (`Effect.sizes`).
        upper: Largest plausible value, likewise.
        grid: Values that the search tries, likewise; empty if the model is linear in the parameter (least squares).
        per_source: Whether the value is a row with one entry per joint (sources).
        natural_bounds: Whether the bounds are physical (zero speed); a value there does not hint at another cause.
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
    """Description of a family of effects.

    Attributes:
        family: Name in the contract.
        equation: Equation in this package's notation.
        source: Publication of the equation.
        signature: Trace of the effect in the residual.
        confounded_with: Families that can look alike.
        excitation: Manoeuvre that makes it identifiable.
        depends_on: Variables (contract, section 4) that the residual depends on; `{joint}` is filled in.
        scope: Which joints it can act on.
        complexity: Flexibility, from 1 (a gain) to 5 (any dependence on a variable). Among equally good explanations,
            the simplest is selected.
        drawn_over: Abscissa of its signature's drawing.
        counted_along: Sign convention of the residual in that drawing.
        parameters: Parameters of the wrapper.
        can_set_in: Whether the search looks for an onset.
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


class Channel(NamedTuple):
    """A measured channel that speeds may depend on; values in its own unit.

    Attributes:
        name: In the machine's YAML.
        lower: What lies below counts as this.
        upper: What lies above counts as this; `lower`, where nothing can be told of the channel.
        usual: Value at which the machine moves as f_θ says; taken where none is known.
        kept: Share of the distance from it that is left a second later, on average.
    """

    name: str
    lower: float
    upper: float
    usual: float
    kept: float = 1.0


@dataclass(frozen=True)
class Setting:
    """Properties of the machine that effects use.

    Attributes:
        dt_s: Time step.
        lower: (n_joint,) lower joint limits, rad or m.
        upper: (n_joint,) upper joint limits.
        speed_scale: (n_joint,) a joint's usual full speed, rad/s or m/s.
        channels: All of the machine's, in order; empty where none is looked at.
    """

    dt_s: float
    lower: np.ndarray
    upper: np.ndarray
    speed_scale: np.ndarray
    channels: tuple[Channel, ...] = ()

    @property
    def n_joint(self) -> int:
        """Number of joints."""
        return len(self.lower)


class Signals(NamedTuple):
    """Signals that an effect reads at one time step; leading batch axes (...).

    Attributes:
        command: (..., n_joint), a_t.
        q: (..., n_joint), the true configuration, rad or m.
        time_s: (...,), since the start of the log.
        channels: (..., n_channel), as last measured, NaN where unknown; None: all are unknown.
    """

    command: jax.Array
    q: jax.Array
    time_s: jax.Array
    channels: jax.Array | None = None


class Effect(ABC):
    """A family's wrapper. Arrays of parameters have shape (n_joint,), or (n_joint, n_joint) per source.

    Attributes:
        needs_proportional_commands: Whether the effect is the identity on commands in {-1, 0, 1}.
        reaches_other_joints: Whether, acting on one joint, it noticeably changes other joints' speeds.
        of_the_machine: Grid parameters with one common value for all affected joints.
        parsimony: Relative gain in explained residual that a variant with more parameters must reach.
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
        """Grid points of the nonlinear parameters: all combinations of their values.

        Lengths are for a joint of `REFERENCE_RANGE`.
        """
        tried = [parameter for parameter in self.card.parameters if parameter.grid]
        names = [parameter.name for parameter in tried]
        return [
            dict(zip(names, point, strict=True))
            for point in product(*(parameter.grid for parameter in tried))
        ]

    def sizes(self, name: str) -> np.ndarray:
        """(n_joint,) factor of a parameter's grid and bounds on each joint."""
        units = {parameter.name: parameter.unit for parameter in self.card.parameters}
        if units[name] != "length":
            return np.ones(self.setting.n_joint)
        return np.minimum((self.setting.upper - self.setting.lower) / REFERENCE_RANGE, 1.0)

    def variants(self) -> list[Variant]:
        """Ways to free the linear parameters: by default all of them, each by itself."""
        sources: list[Freed] = []
        for parameter in self.card.parameters:
            if not parameter.grid:
                indices = range(self.setting.n_joint) if parameter.per_source else [None]
                sources += [((parameter.name, index),) for index in indices]
        return [tuple(sources)]

    def freed_later(self) -> Variant:
        """Linear parameters that do not identify the effect; fitted only after its selection."""
        return ()

    def fitted_later(self) -> dict[str, float]:
        """Nonlinear parameters that are fitted only after selection, with the start of their fit."""
        return {}

    def freed_beside_nominal(self) -> Variant:
        """Parameters for the part of the effect that the nominal logs, and thus f_θ, already contain."""
        return ()

    def initial(self, batch: tuple[int, ...]) -> State:
        """State of a machine that has been at rest."""
        return ()

    def drawn(self, values: Values, key: jax.Array) -> State:
        """State of a machine at rest, without batch axes, where what it hides is drawn; `key` is consumed."""
        return self.initial(())

    def _zeros(self, batch: tuple[int, ...]) -> jax.Array:
        return jnp.zeros((*batch, self.setting.n_joint))


class CommandEffect(Effect):
    """Changes the commands before f_θ sees them."""

    place = Place.command

    @abstractmethod
    def apply(self, values: Values, state: State, command: jax.Array) -> tuple[State, jax.Array]:
        """One step: commands in, commands out, (..., n_joint)."""


class VelocityEffect(Effect):
    """Changes the velocity of the nominal machine.

    Attributes:
        learns_from_errors: Whether its state follows what the model gets wrong.
    """

    learns_from_errors: ClassVar[bool] = False

    @abstractmethod
    def apply(self, values: Values, state: State, u: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One step forward: velocity in, velocity out, (..., n_joint)."""

    @abstractmethod
    def invert(self, values: Values, state: State, v: jax.Array, signals: Signals) -> tuple[State, jax.Array]:
        """One inverse step: measured velocities to nominal ones; the state is updated."""

    def corrected(self, values: Values, state: State, error: jax.Array, displacement: jax.Array) -> State:
        """The state after a step was measured, before `invert` of that step; only where `learns_from_errors`.

        Args:
            values: Of the effect.
            state: Before the step.
            error: Measured minus predicted displacement over the step, (..., n_joint), rad or m.
            displacement: As predicted, (..., n_joint).
        """
        return state

    def ahead(self, values: Values, state: State) -> jax.Array | None:
        """Lead of the frozen model's joint over the moving part, (..., n_joint), rad or m; None if always zero.

        Stops and positions refer to the frozen model's joint.
        """
        return None


class RatioEffect(VelocityEffect):
    """Multiplies the velocity: v = ratio · u.

    Attributes:
        passes: Fixed-point iterations of the inverse; more than one if the ratio depends on the size of u.
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
        """Divide by the ratio, by fixed-point iteration from u = v, which has the sign of u."""
        u = v
        for _ in range(self.passes):
            after, ratio = self.ratio(values, state, u, signals)
            u = v / jnp.maximum(ratio, SMALLEST_RATIO)
        return after, u


class SensorEffect(Effect):
    """Changes the measured configuration."""

    place = Place.sensor

    @abstractmethod
    def measured(self, values: Values, q: jax.Array) -> jax.Array:
        """True to measured configuration."""

    @abstractmethod
    def true(self, values: Values, q: jax.Array) -> jax.Array:
        """Measured to true configuration."""


SMALLEST_COMMAND = 1e-3  # smaller commands count as zero
SMALLEST_RATIO = 0.05  # below it, a measured velocity does not determine the nominal one


def direction_weights(u: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Masks of positive and negative motion."""
    return (u > 0).astype(u.dtype), (u < 0).astype(u.dtype)
