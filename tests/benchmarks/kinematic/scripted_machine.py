"""A kinematic machine with nothing but the effect, driven by a script; and what is read off its logs."""

import numpy as np

from benchmarks.closed_loop.kinematic import effects
from benchmarks.closed_loop.kinematic.machine import JOINTS, Machine, draw_machine
from benchmarks.closed_loop.kinematic.session import drive
from benchmarks.closed_loop.machines import Variant
from benchmarks.closed_loop.sessions import machine as specification
from benchmarks.closed_loop.simulators import KINEMATIC
from pipeline.plant.physics.kinematics import BOOM_PIVOT_RADIUS_M, LINK_LENGTH_M, tip

DT_S = 0.05
SWING, BOOM, ARM, BUCKET = range(4)
FULL_RAD_S = 0.5
FASTEST_S = 1e-9  # time constant of a joint that follows at once
FINE_RAD = 1e-12


def quiet_machine():
    """A machine of which everything that is not the effect is gone: no variation, response at once, exact encoders."""
    drawn = draw_machine(specification(), 0, 1)
    n = len(JOINTS)
    changed = drawn.change("command_path", dead_time_s=np.full(n, 0.1), dead_time_jitter_s=0.0)
    changed = changed.change(
        "speed",
        full_speed_rad_s=np.full((n, 2), FULL_RAD_S),
        pose_dependence=np.zeros(n),
        gravity_loss=np.zeros(n),
        capacity=float(n),
        slow_std=0.0,
        fast_std=0.0,
    )
    fast = np.full(n, FASTEST_S)
    changed = changed.change("motion", rise_time_constant_s=fast, fall_time_constant_s=fast)
    return changed.change("encoder", noise_std_rad=0.0, quantum_rad=FINE_RAD)


QUIET = quiet_machine()
VARIANT = Variant(KINEMATIC, 0, QUIET, 1, (2, 3))


class Script:
    """Somebody who does what is written, whatever the machine does."""

    def __init__(self, commands):
        self.rows = iter(commands)

    def command(self, measured):
        return next(self.rows)


def held(*holds, joint=SWING):
    """Commands of one joint, from pairs of value and duration in s."""
    values = np.concatenate([np.full(round(seconds / DT_S), value) for value, seconds in holds])
    commands = np.zeros((len(values), 4), dtype=np.int8)
    commands[:, joint] = values
    return commands


def driven(machine: Machine, commands, seed=0, start_time_ns=0, changes=()):
    minutes = len(commands) * DT_S / 60.0
    stream = np.random.SeedSequence(seed)
    return drive(specification(), machine, Script(commands), minutes, stream, start_time_ns, changes)


def speeds(log, joint):
    """Mean true speed of each control period but the first, rad/s."""
    return np.diff(log.true_positions[:, joint]) / DT_S


def drawn_effect(kind, seed=0, size=1.0, where=None):
    """The first effect of a kind, from a seed on, that is as wanted."""
    for number in range(seed, seed + 200):
        effect = effects.draw(kind, number, VARIANT, size)
        if where is None or where(effect):
            return effect
    raise AssertionError(kind)


def value(effect, name):
    return effect.truth[name].value


def on_joint(name):
    return lambda effect: effect.joints == (name,)


BACK_AND_FORTH = held(*[(1, 1.0), (-1, 1.0)] * 60)


def moving_ratio(log, joint=SWING):
    """Speed over full speed by control period, where the joint moved all through it; with times, s."""
    speed = np.abs(speeds(log, joint))
    settled = np.ones(len(speed), dtype=bool)
    settled[1::20] = False  # in which it reverses
    return DT_S * (1.5 + np.flatnonzero(settled)), speed[settled] / FULL_RAD_S


def plant_levers(q):
    """The same from the plant's own geometry: the tip's distance from each axis along the ground."""
    radius_m = tip(q)[0][0] - BOOM_PIVOT_RADIUS_M
    angles = np.cumsum(q[1:])
    inner_m = np.concatenate([[0.0], np.cumsum(LINK_LENGTH_M * np.cos(angles))[:-1]])
    return np.concatenate([[0.0], (radius_m - inner_m) / np.cumsum(LINK_LENGTH_M[::-1])[::-1]])
