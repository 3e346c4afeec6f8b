"""Every quantity of the kinematic machine with its unit, and the sound machines, drawn by seed.

Shapes: `(n,)` one value per joint in the machine's joint order, `(n, 2)` one per joint and direction of motion, index
`NEGATIVE` and `POSITIVE`. An effect is a change of these quantities; those that only effects have are neutral in a
sound machine. All ranges are assumed, such that full speeds and times to 90 % of them are the contract's (section 1).
"""

import enum
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

NEGATIVE, POSITIVE = 0, 1
"""Indices of the two directions of motion."""

JOINTS = ("swing", "boom", "arm", "bucket")
"""Of the benchmark's machine; what follows is in this order."""

MIDDLE_SPEED_RAD_S = np.array([[0.50, 0.50], [0.42, 0.42], [0.55, 0.52], [0.66, 0.68]])
"""(n, 2) Full speeds of the class; the contract has 0.25 to 0.7 rad/s."""
SPEED_TOLERANCE = 0.1  # of one machine's full speed to the next's
DEAD_TIME_S = (0.04, 0.14)
DEAD_TIME_JITTER_S = 0.015
RISE_S, FALL_S = (0.12, 0.28), (0.06, 0.14)
LARGEST_POSE_DEPENDENCE = 0.1
LARGEST_GRAVITY_LOSS = np.array([0.0, 0.12, 0.12, 0.07])  # (n,) gravity does not act on swing
CAPACITY = (1.8, 3.0)  # joints at full speed that the supply can feed at once
SLOW_STD, SLOW_CORRELATION_S = (0.006, 0.015), 20.0
FAST_STD, FAST_CORRELATION_S = (0.015, 0.030), 0.4
ENCODER_PERIOD_S, ENCODER_JITTER_S = 0.02, 0.0035  # 50 Hz
ENCODER_NOISE_RAD = (2.5e-4, 3.5e-4)
ENCODER_QUANTUM_RAD = 2.0 * np.pi / 2**13
NO_EFFECT_TIME_S = 1.0  # time constants of what has no strength: any positive number does


class CommandPath(NamedTuple):
    """From the stick to the valve."""

    dead_time_s: np.ndarray
    """(n,)"""
    dead_time_jitter_s: float
    """Half width of the even spread of each command's dead time: a controller's cycle whose phase nobody knows."""
    rest_threshold_s: np.ndarray
    """(n,) Starts after longer rests stick."""
    mean_extra_time_s: np.ndarray
    """(n,) For how long in the mean they do."""


class Speed(NamedTuple):
    """The speed that a command asks for. All losses are shares of it, 1."""

    full_speed_rad_s: np.ndarray
    """(n, 2) Of a single joint at mean gravity, pose and supply; positive."""
    pose_dependence: np.ndarray
    """(n,) Amplitude of the factor 1 + p sin 2q: linkages do not turn evenly."""
    gravity_loss: np.ndarray
    """(n,) Loss while raising, gain while lowering, with the lever at its longest."""
    load_loss: np.ndarray
    """(n,) The same of a payload."""
    capacity: float
    """Joints at full command that are fed in full; more of them share."""
    coupling_loss: float
    """Loss of a joint while all others are at full command."""
    cold_loss: float
    """Loss at the start of the session, decaying with `warm_up_s`."""
    warm_up_s: float
    slow_std: float
    """Standard deviation of the logarithm of all joints' speed: engine and oil of a sound machine."""
    slow_correlation_s: float
    fast_std: float
    """The same of each joint for itself."""
    fast_correlation_s: float
    supply_std: float
    """The same of all joints together, where the supply is not sound."""
    supply_correlation_s: float
    cushion_zone_rad: np.ndarray
    """(n, 2) Before which limit the joint is slowed, from how far on."""
    cushion_ratio: np.ndarray
    """(n, 2) Share of the speed that is left at that limit."""


class Motion(NamedTuple):
    """From the speed that is asked for to the joint's angle."""

    lower_rad: np.ndarray
    """(n,) Stops."""
    upper_rad: np.ndarray
    rise_time_constant_s: np.ndarray
    """(n,) While the speed grows."""
    fall_time_constant_s: np.ndarray
    """(n,) While it falls or changes its sign."""
    added_time_constant_s: np.ndarray
    """(n,) Of another system of first order behind; 0: there is none."""
    resonance_Hz: np.ndarray
    """(n,) Undamped natural frequency of a system of second order behind that; 0: there is none."""
    damping_ratio: np.ndarray
    """(n,) Of it, below 1."""
    sag_rate_rad_s: np.ndarray
    """(n,) Speed at zero command, with its sign."""
    play_rad: np.ndarray
    """(n,) Between drive and link."""


class Encoder(NamedTuple):
    """From the angle to the reading. Stamps are of the moment at which a reading is taken over."""

    period_s: float
    jitter_s: float
    """Half width of the even spread of each stamp."""
    noise_std_rad: float
    quantum_rad: float
    offset_rad: np.ndarray
    """(n,)"""
    scale: np.ndarray
    """(n,) About the joint's zero."""
    latency_s: float
    """Mean age of a reading at its stamp."""
    latency_jitter_s: float
    """Half width of the even spread of that age; at most the latency."""


class Dependences(NamedTuple):
    """What no family of the contract describes: speed that depends on what it should not."""

    command_ratio: np.ndarray
    """(n, n, 2) At [j, i, d]: speed ratio of joint j while joint i is commanded in direction d."""
    hold_loss: np.ndarray
    """(n,) Loss of a joint whose command has been held for long."""
    hold_s: float
    travel_loss_per_rad: np.ndarray
    """(n,) Loss per way that the joint has gone since the session's start."""
    activity_loss: float
    """Loss of all joints at typical activity, `TYPICAL_ACTIVITY`."""
    activity_s: float
    """Over how long activity is averaged."""
    position_loss: np.ndarray
    """(n, n) At [j, i]: loss of joint j while joint i is beyond a place."""
    position_rad: np.ndarray
    """(n, n) Where the loss begins; it is whole `POSITION_RAMP_RAD` farther on."""
    cycle_loss: np.ndarray
    """(n,) Loss in the first half of each period of the wall clock."""
    cycle_s: float
    boost: np.ndarray
    """(n,) Gain of a joint whose command has been held for longer than `boost_s`."""
    boost_s: float
    lockout_s: np.ndarray
    """(n,) For how long a valve stays shut once its command's sign is reversed."""


TYPICAL_ACTIVITY = 0.25  # mean |command| over the joints
LARGEST_ACTIVITY = 2.0  # times that: what the loss does not grow beyond
POSITION_RAMP_RAD = 0.4
LEAST_TRAVEL_RATIO = 0.2  # of speed, however far a joint went


class Quantities(NamedTuple):
    """All of one machine."""

    command_path: CommandPath
    speed: Speed
    motion: Motion
    encoder: Encoder
    dependences: Dependences


class Work(enum.Enum):
    """What a machine is used for, and so who drives it."""

    painting = enum.auto()  # the plant's operator, who goes from place to place
    random_holds = enum.auto()  # each joint for itself, at random


@dataclass(frozen=True)
class Machine:
    """One kinematic machine in one state."""

    quantities: Quantities
    work: Work

    def change(self, group: str, **values: np.ndarray | float) -> "Machine":
        """With other values in one group of quantities (a field of `Quantities`)."""
        changed = getattr(self.quantities, group)._replace(**values)
        return replace(self, quantities=self.quantities._replace(**{group: changed}))


def draw_machine(specification: MachineSpecification, number: int, seed: int) -> Machine:
    """A sound machine.

    Args:
        specification: Names and limits.
        number: Of the machine; machines in turn paint and are driven at random, so that any two do both.
        seed: Of all its quantities.

    Raises:
        InputError: The machine does not have the joints that are described here.
    """
    if specification.joint_names != JOINTS:
        raise InputError(
            f"conf/machine/{specification.name}.yaml: joints are {', '.join(specification.joint_names)}; the "
            f"kinematic simulator has {', '.join(JOINTS)}"
        )
    random, n = np.random.default_rng(seed), len(JOINTS)

    def each(bounds: tuple[float, float]) -> np.ndarray:
        return random.uniform(*bounds, n)

    def one(bounds: tuple[float, float]) -> float:
        return float(random.uniform(*bounds))

    factor = random.uniform(1.0 - SPEED_TOLERANCE, 1.0 + SPEED_TOLERANCE, (n, 2))
    quantities = Quantities(
        CommandPath(
            dead_time_s=each(DEAD_TIME_S),
            dead_time_jitter_s=DEAD_TIME_JITTER_S,
            rest_threshold_s=np.zeros(n),
            mean_extra_time_s=np.zeros(n),
        ),
        Speed(
            full_speed_rad_s=MIDDLE_SPEED_RAD_S * factor,
            pose_dependence=LARGEST_POSE_DEPENDENCE * each((-1.0, 1.0)),
            gravity_loss=LARGEST_GRAVITY_LOSS * each((0.0, 1.0)),
            load_loss=np.zeros(n),
            capacity=one(CAPACITY),
            coupling_loss=0.0,
            cold_loss=0.0,
            warm_up_s=NO_EFFECT_TIME_S,
            slow_std=one(SLOW_STD),
            slow_correlation_s=SLOW_CORRELATION_S,
            fast_std=one(FAST_STD),
            fast_correlation_s=FAST_CORRELATION_S,
            supply_std=0.0,
            supply_correlation_s=NO_EFFECT_TIME_S,
            cushion_zone_rad=np.zeros((n, 2)),
            cushion_ratio=np.ones((n, 2)),
        ),
        Motion(
            lower_rad=specification.lower,
            upper_rad=specification.upper,
            rise_time_constant_s=each(RISE_S),
            fall_time_constant_s=each(FALL_S),
            added_time_constant_s=np.zeros(n),
            resonance_Hz=np.zeros(n),
            damping_ratio=np.zeros(n),
            sag_rate_rad_s=np.zeros(n),
            play_rad=np.zeros(n),
        ),
        Encoder(
            period_s=ENCODER_PERIOD_S,
            jitter_s=ENCODER_JITTER_S,
            noise_std_rad=one(ENCODER_NOISE_RAD),
            quantum_rad=ENCODER_QUANTUM_RAD,
            offset_rad=np.zeros(n),
            scale=np.ones(n),
            latency_s=0.0,
            latency_jitter_s=0.0,
        ),
        Dependences(
            command_ratio=np.ones((n, n, 2)),
            hold_loss=np.zeros(n),
            hold_s=NO_EFFECT_TIME_S,
            travel_loss_per_rad=np.zeros(n),
            activity_loss=0.0,
            activity_s=NO_EFFECT_TIME_S,
            position_loss=np.zeros((n, n)),
            position_rad=np.zeros((n, n)),
            cycle_loss=np.zeros(n),
            cycle_s=NO_EFFECT_TIME_S,
            boost=np.zeros(n),
            boost_s=NO_EFFECT_TIME_S,
            lockout_s=np.zeros(n),
        ),
    )
    return Machine(quantities, Work.painting if number % 2 else Work.random_holds)
