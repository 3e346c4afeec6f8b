"""The supervisor's rules over a whole recording, as arrays: when each of them objects.

`tests/benchmarks/test_rule_arrays.py` compares them with the components, message by message.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.supervision.self_collision import SelfCollision
from pipeline.deployment.settings import SupervisorConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig, advance, initial_state
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import Envelope

HORIZON_M = 1.0  # of distances between links: one that is larger spares the next ones
TRACKER = LoopTrackerConfig(10.0, 60.0)


@dataclass(frozen=True)
class Heard:
    """What the supervisor heard, in order of arrival: N joint states and M commands of one server; times in ns."""

    stamp_ns: np.ndarray
    state_ns: np.ndarray
    q: np.ndarray  # (N, n_joint) rad
    sent_ns: np.ndarray
    command_ns: np.ndarray
    a: np.ndarray  # (M, n_joint)

    @cached_property
    def is_moving(self) -> np.ndarray:
        """(N,) whether a joint state is later than all before it."""
        before = np.maximum.accumulate(self.stamp_ns[:-1])
        return np.concatenate([[True], self.stamp_ns[1:] > before])


@dataclass(frozen=True)
class Parts:
    """What the rules judge by; shapes and envelope are those of `RuleParts`."""

    machine: MachineSpecification
    config: SupervisorConfig
    shapes: SelfCollision
    envelope: Envelope

    @cached_property
    def reach_m(self) -> np.ndarray:
        """(n_joint,) no point of a shape is farther from a joint's axis, whatever the others' angles."""
        model, reach_m = self.shapes._model, np.zeros(self.machine.n_joint)
        for shape in range(model.ngeom):
            way_m = np.linalg.norm(model.geom_pos[shape]) + model.geom_rbound[shape]
            body = model.geom_bodyid[shape]
            while body:
                for joint in range(
                    model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]
                ):
                    of = self.machine.joint_names.index(model.joint(joint).name)
                    reach_m[of] = max(reach_m[of], way_m)
                way_m += np.linalg.norm(model.body_pos[body])
                body = model.body_parentid[body]
        return reach_m


def objections(parts: Parts, heard: Heard) -> dict[str, np.ndarray]:
    """Times, ns, at which each rule but `model_residual` objects to a joint state, a command or at a tick."""
    config = parts.config
    ticks = np.arange(heard.state_ns[0], heard.state_ns[-1], nanoseconds(config.period_s))
    return {
        "command_frequency": _command_frequency(config, heard, ticks),
        "command_delay": heard.command_ns[
            _is_old(heard.command_ns - heard.sent_ns, config.maximum_command_delay_s, config)
        ],
        "state_frequency": _state_frequency(config, heard, ticks),
        "encoder_reading": _encoder_reading(parts, heard),
        "frozen_encoder": _frozen_encoder(parts, heard, ticks),
        "joint_limits": _joint_limits(parts, heard, ticks),
        "self_collision": _self_collision(parts, heard, ticks),
        "envelope": _envelope(parts, heard, ticks),
    }


def _is_old(age_ns: np.ndarray, maximum_s: float, config: SupervisorConfig) -> np.ndarray:
    return (age_ns > nanoseconds(maximum_s)) | (age_ns < -nanoseconds(config.clock_tolerance_s))


def _newest(times_ns: np.ndarray, at_ns: np.ndarray) -> np.ndarray:
    """Index of the last of ascending times that is not after each time, -1 for none."""
    return np.searchsorted(times_ns, at_ns, side="right") - 1


def _command_frequency(config: SupervisorConfig, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    times = heard.command_ns
    within = np.arange(len(times)) - _newest(times, times - NANOSECONDS)
    last = _newest(times, ticks)
    is_missing = (last >= 0) & (ticks - times[last] > nanoseconds(config.maximum_command_gap_s))
    return np.sort(np.concatenate([times[within > config.maximum_command_rate_hz], ticks[is_missing]]))


def _state_frequency(config: SupervisorConfig, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    times, stamps = heard.state_ns, heard.stamp_ns
    is_late = _is_old(times - stamps, config.maximum_state_delay_s, config)
    is_late[1:] |= stamps[1:] <= stamps[:-1]
    is_missing = ticks - times[_newest(times, ticks)] > nanoseconds(config.maximum_state_gap_s)
    return np.sort(np.concatenate([times[is_late], ticks[is_missing]]))


def _encoder_reading(parts: Parts, heard: Heard) -> np.ndarray:
    config, joint_range = parts.config, parts.machine.upper - parts.machine.lower
    passed_s = np.maximum(np.diff(heard.stamp_ns), 0)[:, None] * 1e-9
    allowed = config.jump_tolerance * joint_range + config.maximum_speed * joint_range * passed_s
    return heard.state_ns[1:][(np.abs(np.diff(heard.q, axis=0)) > allowed).any(axis=1)]


def _at_limit(parts: Parts, q: np.ndarray) -> np.ndarray:
    margin = parts.config.limit_tolerance * (parts.machine.upper - parts.machine.lower)
    return (q <= parts.machine.lower + margin) | (q >= parts.machine.upper - margin)


def _since(times_ns: np.ndarray, begins: np.ndarray) -> np.ndarray:
    """Of each row the time of the last row, itself included, in which something began: (K, n_joint)."""
    return np.maximum.accumulate(np.where(begins, times_ns[:, None], 0))


def _frozen_encoder(parts: Parts, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    in_force = _newest(heard.command_ns, heard.state_ns)
    command = np.where(in_force[:, None] >= 0, heard.a[in_force], 0)
    resets = _at_limit(parts, heard.q) | (np.abs(command) < parts.config.frozen_command)
    resets[0] = True
    resets[1:] |= heard.q[1:] != heard.q[:-1]
    since = _since(heard.state_ns, resets)[_newest(heard.state_ns, ticks)]
    return ticks[(ticks[:, None] - since > nanoseconds(parts.config.frozen_after_s)).any(axis=1)]


def _joint_limits(parts: Parts, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    lower, upper = parts.machine.lower, parts.machine.upper
    margin = parts.config.limit_tolerance * (upper - lower)
    is_outside = ((heard.q < lower - margin) | (heard.q > upper + margin)).any(axis=1)
    at_stop, direction = _at_limit(parts, heard.q), np.sign(heard.a)
    comes = ~at_stop
    comes[0] = True
    comes[1:] |= ~at_stop[:-1]
    turns = np.diff(direction, axis=0, prepend=0) != 0
    state, command = _newest(heard.state_ns, ticks), _newest(heard.command_ns, ticks)
    has_any = command[:, None] >= 0
    since = np.maximum(
        _since(heard.state_ns, comes)[state],
        np.where(has_any, _since(heard.command_ns, turns)[command], 0),
    )
    presses = at_stop[state] & has_any & (direction[command] != 0)
    is_long = (presses & (ticks[:, None] - since > nanoseconds(parts.config.maximum_stop_s))).any(axis=1)
    return np.sort(np.concatenate([heard.state_ns[is_outside], ticks[is_long]]))


def _fresh(heard: Heard, ticks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ticks before which a joint state came, and its index."""
    newest = _newest(heard.state_ns, ticks)
    is_fresh = np.diff(newest, prepend=-1) > 0
    return ticks[is_fresh], newest[is_fresh]


def _envelope(parts: Parts, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    ticks, newest = _fresh(heard, ticks)
    is_inside = holds(parts.envelope, heard.q[newest])
    return ticks[np.logical_or.accumulate(is_inside) & ~is_inside]


def holds(envelope: Envelope, q: np.ndarray) -> np.ndarray:
    """Whether rows (K, n_joint) lie inside, (K,); rows are filled up, as each number of them is compiled anew."""
    filled = np.zeros((-(-len(q) // 16384) * 16384, q.shape[1]))
    filled[: len(q)] = q
    return envelope.holds_each(filled)[: len(q)]


def _self_collision(parts: Parts, heard: Heard, ticks: np.ndarray) -> np.ndarray:
    ticks, newest = _fresh(heard, ticks)
    q = heard.q[newest]
    soon = q + parts.config.prediction_s * velocities(parts.machine, heard)[newest]
    both = np.stack([q, soon], axis=1).reshape(-1, q.shape[1])  # neighbours: one distance spares many
    return ticks[_is_near(parts, both).reshape(-1, 2).any(axis=1)]


def _is_near(parts: Parts, q: np.ndarray) -> np.ndarray:
    """Whether links come too near in rows (K, n_joint), (K,): no distance shrinks by more than links' points move."""
    is_near, row = np.zeros(len(q), bool), 0
    while row < len(q):
        spare_m = parts.shapes.clearance(q[row], HORIZON_M) - parts.config.clearance_m
        is_near[row] = spare_m < 0.0
        ahead = np.abs(q[row + 1 : row + 1001] - q[row]) @ parts.reach_m >= spare_m
        row += 1 + (int(np.argmax(ahead)) if ahead.any() else len(ahead))
    return is_near


def velocities(machine: MachineSpecification, heard: Heard) -> np.ndarray:
    """What the driver tells with each joint state, (N, n_joint), rad/s: the loop tracker on the machine's grid."""
    stamps, q = heard.stamp_ns[heard.is_moving], heard.q[heard.is_moving]
    grid = np.arange(stamps[0] + nanoseconds(machine.dt_s), stamps[-1] + 1, nanoseconds(machine.dt_s))
    rows = np.stack([np.interp(grid, stamps, joint) for joint in q.T], axis=1)
    state = initial_state(q[0])
    told = [state.integral]
    for row in rows:
        state, velocity = advance(state, row, machine.dt_s, TRACKER)
        told.append(velocity)
    return np.stack(told)[_newest(grid, np.maximum.accumulate(heard.stamp_ns)) + 1]
