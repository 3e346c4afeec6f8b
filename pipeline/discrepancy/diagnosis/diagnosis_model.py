"""The diagnosis model: from commands and positions to velocity, without measured velocities among its inputs.

A model that is fed measured velocities shows little of an effect in its one-step residual, because the effect is in
its input already. This one is driven by commands alone, so that its residual shows all of it.

It is an ensemble. The nominal rows are cut into as many parts as there are members, and no member is trained on
its own part: what it is off there is the honest residual of a machine without any effect.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.training_support import is_often
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.model.shown_motion import STANDING_SHARE, Shown
from pipeline.dynamics.model.shown_motion import standing as stands_against
from pipeline.errors import InputError

Weights = dict[str, jax.Array]


@dataclass
class DiagnosisModelConfig:
    """How the diagnosis model is trained.

    Attributes:
        lags: Commands that it sees, the newest one included.
        hidden: Units of each of its two hidden layers.
        members: Parts that the nominal rows are cut into; one network leaves each out.
        segment_rows: Rows of a training segment.
        batch_segments: Segments per update.
        updates: Gradient steps.
        learning_rate: At the start; it falls to zero as a half cosine.
        weight_decay: Of AdamW.
        displacement_weight: Weight of the error of displacements since the segment's start, beside velocities'.
    """

    lags: int
    hidden: int
    members: int
    segment_rows: int
    batch_segments: int
    updates: int
    learning_rate: float
    weight_decay: float
    displacement_weight: float

    def __post_init__(self) -> None:
        for name in ("lags", "hidden", "segment_rows", "batch_segments", "updates"):
            if getattr(self, name) < 1:
                raise InputError(
                    f"close_loop.diagnosis.{name} is {getattr(self, name)}; it must be at least 1"
                )
        if self.members < 2:
            raise InputError(f"close_loop.diagnosis.members is {self.members}; it must be at least 2")
        if not self.learning_rate > 0:
            raise InputError(
                f"close_loop.diagnosis.learning_rate is {self.learning_rate}; it must be positive"
            )


class Scales(NamedTuple):
    """What the networks' inputs and outputs are scaled by, each (n_joint,).

    Attributes:
        lower: Joint limits, rad or m.
        upper: Joint limits.
        speed: Root mean square of the velocity while moving, rad/s or m/s.
        stop_lower: Where the joint stands against its lower stop, or the lower limit where unknown; -inf where
            logs go beyond it.
        stop_upper: The same above.
    """

    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    stop_lower: np.ndarray
    stop_upper: np.ndarray


@dataclass(frozen=True)
class DiagnosisModel:
    """A trained ensemble.

    Attributes:
        weights: Of all members, stacked in front.
        scales: Of inputs and outputs.
        lags: Commands that it sees.
        dt_s: Length of one time step.
        left_out: Per member (B, T) bool: the nominal rows that it was not trained on.
        is_switched: Whether commands are -1, 0 or 1, so that their number says what joints ask for together.
    """

    weights: Weights
    scales: Scales
    lags: int
    dt_s: float
    left_out: np.ndarray
    is_switched: bool

    def members_velocity(self, command: jax.Array, q: jax.Array) -> jax.Array:
        """Velocity by each member, (n_members, ..., T, n_joint), before the stops."""
        inputs = _inputs(command, q, self.scales, self.lags, self.is_switched)
        return jax.vmap(lambda weights: _network(weights, inputs))(self.weights) * self.scales.speed

    def stopped(self, velocity: jax.Array, q: jax.Array) -> jax.Array:
        """The velocity, as far as the stops allow."""
        lower = (self.scales.stop_lower - q) / self.dt_s
        upper = (self.scales.stop_upper - q) / self.dt_s
        return jnp.clip(velocity, jnp.minimum(lower, 0.0), jnp.maximum(upper, 0.0))


def train_diagnosis_model(
    nominal: Sequences,
    lower: np.ndarray,
    upper: np.ndarray,
    dt_s: float,
    config: DiagnosisModelConfig,
    seed: int,
    is_switched: bool,
) -> DiagnosisModel:
    """Train all members at once.

    Args:
        nominal: Rows of the machine as it was when the model was identified.
        lower: (n_joint,) joint limits.
        upper: (n_joint,) joint limits.
        dt_s: Length of one time step.
        config: Size and training.
        seed: Initial weights and order of the segments.
        is_switched: Whether commands are -1, 0 or 1.

    Raises:
        UnusableLogs: They are too short for a training segment per member.
    """
    parts = _parts(nominal.is_row, config.members)
    segments = _segments(nominal.is_row, parts, config)
    scales = _scales(nominal, lower, upper)
    columns = (nominal.command, nominal.q, nominal.velocity, ~standing(nominal, scales))
    data = tuple(jnp.asarray(column, jnp.float32) for column in columns)
    keys = jax.random.split(jax.random.key(seed), config.members)
    compiled = _train.lower(
        keys[0], jnp.asarray(segments[0]), data, scales, dt_s, _Static(config), is_switched
    ).compile()
    with ThreadPoolExecutor() as pool:  # matrices this small do not fill a core each
        trained = list(
            pool.map(lambda key, starts: compiled(key, starts, data, scales), keys, jnp.asarray(segments))
        )
    weights = jax.tree.map(lambda *members: jnp.stack(members), *trained)
    left_out = np.stack([parts == member for member in range(config.members)])
    return DiagnosisModel(weights, scales, config.lags, dt_s, left_out, is_switched)


class _Static:
    """A configuration as a compile-time constant."""

    def __init__(self, config: DiagnosisModelConfig) -> None:
        self.config = config
        self._key = repr(config)

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Static) and self._key == other._key


@partial(jax.jit, static_argnums=(4, 5, 6))
def _train(
    key: jax.Array,
    starts: jax.Array,
    data: tuple,
    scales: Scales,
    dt_s: float,
    static: _Static,
    is_switched: bool,
) -> Weights:
    """Train one member on the segments that begin at `starts`."""
    config = static.config
    command, q, velocity, weight = data
    n_joint = command.shape[-1]
    inputs = _inputs(command, q, scales, config.lags, is_switched)
    lower = jnp.minimum((scales.stop_lower - q) / dt_s, 0.0) / scales.speed
    upper = jnp.maximum((scales.stop_upper - q) / dt_s, 0.0) / scales.speed
    flat = [
        array.reshape(-1, array.shape[-1])
        for array in (inputs, velocity / scales.speed, lower, upper, weight)
    ]
    optimiser = optax.adamw(
        optax.cosine_decay_schedule(config.learning_rate, config.updates), weight_decay=config.weight_decay
    )

    def loss(weights: Weights, starts: jax.Array) -> jax.Array:
        rows = starts[:, None] + jnp.arange(config.segment_rows)
        x, y, low, high, weight = (array[rows] for array in flat)
        error = weight * (jnp.clip(_network(weights, x), low, high) - y)
        displacement = jnp.cumsum(error, axis=1)
        return jnp.mean(error**2) + config.displacement_weight * jnp.mean(displacement**2)

    weights_key, order_key = jax.random.split(key)
    weights = _initial(weights_key, inputs.shape[-1], config.hidden, n_joint)

    def update(carry: tuple, key: jax.Array) -> tuple[tuple, None]:
        weights, state = carry
        batch = jax.random.choice(key, starts, (config.batch_segments,))
        updates, state = optimiser.update(jax.grad(loss)(weights, batch), state, weights)
        return (optax.apply_updates(weights, updates), state), None

    carry = (weights, optimiser.init(weights))
    (weights, _), _ = jax.lax.scan(update, carry, jax.random.split(order_key, config.updates))
    return weights


def _initial(key: jax.Array, n_in: int, hidden: int, n_joint: int) -> Weights:
    keys = jax.random.split(key, 3)
    return {
        "w1": jax.random.normal(keys[0], (n_in, hidden)) * 0.5 / np.sqrt(n_in),
        "b1": jnp.zeros(hidden),
        "w2": jax.random.normal(keys[1], (hidden, hidden)) / np.sqrt(hidden),
        "b2": jnp.zeros(hidden),
        "w3": jax.random.normal(keys[2], (hidden, n_joint)) / np.sqrt(hidden),
        "b3": jnp.zeros(n_joint),
    }


def _network(weights: Weights, x: jax.Array) -> jax.Array:
    x = jax.nn.silu(x @ weights["w1"] + weights["b1"])
    x = jax.nn.silu(x @ weights["w2"] + weights["b2"])
    return x @ weights["w3"] + weights["b3"]


def _inputs(command: jax.Array, q: jax.Array, scales: Scales, lags: int, is_switched: bool) -> jax.Array:
    """Commands of rows t-lags+1 … t, what they ask for together, and the normalised position of row t: (..., T, n).

    Joints that share a supply are slower together from the point on where they ask for more than there is: by how many
    the joints that are commanded exceed one, two, up to all but two goes in, as means over stretches of the lags. Told
    so, the network need not learn it joint by joint; of an operator who moves one at a time, logs hold few rows of any
    three. Of proportional commands, whose sum says little of what valves let through, nothing is told.
    """
    n_rows, n_joint = command.shape[-2:]
    before = [(0, 0)] * (command.ndim - 2) + [(lags - 1, 0), (0, 0)]
    known = jnp.pad(command, before)
    windows = [known[..., lag : lag + n_rows, :] for lag in range(lags)]
    together = jnp.stack([jnp.sum(jnp.abs(window), axis=-1, keepdims=True) for window in windows])
    numbers = range(1, n_joint - 1) if is_switched else ()
    beyond = [jnp.maximum(together - number, 0.0) for number in numbers]
    ends = [lags - 2**k for k in reversed(range(lags.bit_length())) if 2**k < lags]
    stretches = np.split(np.arange(lags), ends)  # short ones for what is new
    demand = [jnp.mean(of[stretch], axis=0) for of in beyond for stretch in stretches]
    place = 2.0 * (q - scales.lower) / (scales.upper - scales.lower) - 1.0
    return jnp.concatenate([*windows, place, *demand], axis=-1)


def _parts(is_row: np.ndarray, n_parts: int) -> np.ndarray:
    """(B, T) the part of each row: consecutive rows, of about equal number; what is no row goes with the one before."""
    order = np.maximum(np.cumsum(is_row.ravel()) - 1, 0)
    return (order * n_parts // max(int(is_row.sum()), 1)).reshape(is_row.shape)


def _segments(is_row: np.ndarray, parts: np.ndarray, config: DiagnosisModelConfig) -> np.ndarray:
    """(n_members, n) flat start rows of the segments that a member may be trained on."""
    n_rows = is_row.shape[1]
    flat_row, flat_part = is_row.ravel(), parts.ravel()
    starts = np.arange(flat_row.size - config.segment_rows)
    last = starts + config.segment_rows - 1
    whole = flat_row[starts] & flat_row[last] & (starts // n_rows == last // n_rows)
    allowed = [
        starts[whole & (flat_part[starts] != member) & (flat_part[last] != member)]
        for member in range(config.members)
    ]
    if min(map(len, allowed)) == 0:
        raise UnusableLogs(
            "nominal",
            f"too short for the diagnosis, which needs more than {config.members} times "
            f"{config.segment_rows} rows without a gap; give longer logs",
        )
    longest = max(map(len, allowed))
    return np.stack([np.resize(starts, longest) for starts in allowed])


PARTS_OF_RANGE = 20
SMALLEST_VISITS_SHARE = 0.008  # of moving rows, per part of the range
SMALLEST_TOGETHER_SHARE = 0.002  # of moving rows, per number of joints that are commanded at once


def _scales(nominal: Sequences, lower: np.ndarray, upper: np.ndarray) -> Scales:
    rows = nominal.is_row
    shown = Shown(nominal.command[rows], nominal.q[rows], nominal.velocity[rows])
    speed = shown.usual_speed()
    return Scales(lower, upper, speed, *shown.stops(lower, upper, speed))


def standing(sequences: Sequences, scales: Scales) -> np.ndarray:
    """Where a joint is pushed against its stop, (B, T, n_joint): how exactly it stands there says nothing of speeds."""
    rows = sequences.q, sequences.velocity, sequences.command
    stops = scales.stop_lower, scales.stop_upper
    return np.logical_or(*stands_against(*rows, *stops, scales.upper - scales.lower, scales.speed))


def is_known(nominal: Sequences, sequences: Sequences, scales: Scales, is_switched: bool) -> np.ndarray:
    """Where nominal logs show how a joint moves, (B, T, n_joint).

    It stands in a part of its range that it often moved through, and, of a machine with switches, as many joints are
    commanded as sometimes were while it moved. Elsewhere the diagnosis model extrapolates, and what it is off there is
    no sign of an effect.
    """
    result = np.zeros(sequences.q.shape, bool)
    together, asked_together = (np.abs(of.command).sum(axis=-1) for of in (nominal, sequences))
    numbers = np.arange(nominal.command.shape[-1] + 2) - 0.5
    for joint in range(nominal.q.shape[-1]):
        edges = np.linspace(scales.lower[joint], scales.upper[joint], PARTS_OF_RANGE + 1)
        moving = nominal.is_row & (
            np.abs(nominal.velocity[..., joint]) > STANDING_SHARE * scales.speed[joint]
        )
        asked = sequences.q[..., joint]
        result[..., joint] = is_often(nominal.q[..., joint][moving], asked, edges, SMALLEST_VISITS_SHARE)
        asks = np.abs(sequences.command[..., joint]) > 0.0
        if is_switched:
            known = is_often(together[moving], asked_together, numbers, SMALLEST_TOGETHER_SHARE)
            result[..., joint] &= known | ~asks
    return result
