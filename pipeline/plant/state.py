"""The plant's state, as arrays that the compiled loop changes in place."""

from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.plant.parameters import NEGATIVE, POSITIVE, Parameters
from pipeline.plant.physics.load import gravity_torque

# Indices of `State.energy_J`, all integrated from the start.
PUMP, THROTTLED, PISTON, FRICTION, STOP = range(5)
N_ENERGY = 5
# Indices of `State.volume_m3`, all integrated from the start.
DELIVERED, BYPASSED, RELIEVED, CONSUMED, STORED = range(5)
N_VOLUME = 5
# Indices of `State.switches`.
LATE, OTHERS = range(2)
N_SWITCH = 2


class State(NamedTuple):
    """The plant's complete state between substeps."""

    angle_rad: np.ndarray  # (n,) on the drive's side of the pin clearance
    velocity_rad_s: np.ndarray  # (n,)
    link_angle_rad: np.ndarray  # (n,) on the link's side: the true joint angle
    chamber_Pa: np.ndarray  # (n, 2)
    supply_Pa: np.ndarray  # (1,)
    pilot_Pa: np.ndarray  # (n, 2)
    coil_warmth: np.ndarray  # (n, 2) 0 cold, 1 held on for long
    pilot_activity: np.ndarray  # (1,) 0 rest, 1 all pilots on for long
    spool: np.ndarray  # (n,) stroke in [-1, 1]
    spool_rest_s: np.ndarray  # (n,) since the spool last moved
    silt_factor: np.ndarray  # (n,) this activation's strength of the silt lock
    engine_speed: np.ndarray  # (1,) relative to rated
    disturbance: np.ndarray  # (n + 2,) pilot noise per joint, engine ripple, relief wander; unit variance
    line_volume_m3: np.ndarray  # (n,) oil that has passed each joint's lines
    oil_C: np.ndarray  # (1,)
    heat_J: np.ndarray  # (1,) dissipated since the heat balance was last advanced
    command_ring: np.ndarray  # (n_ring, n) int8, commands as the controller read them, one row per substep
    ring_index: np.ndarray  # (1,) int64, substeps since the start
    controller_command: np.ndarray  # (n,) int8, what the controller read last
    switches: np.ndarray  # (N_SWITCH,) int8, whether commands are late, and whether other functions run
    touches: np.ndarray  # (1,) int8, whether the tip is on the ground or the base
    contacts: np.ndarray  # (1,) int64, how often it met one of them since the start
    energy_J: np.ndarray  # (N_ENERGY,)
    volume_m3: np.ndarray  # (N_VOLUME,)


def viewed(record: np.ndarray) -> State:
    """The state in one record; its arrays change with the record's."""
    return State(*(record[name][0] for name in State._fields))


LONGEST_DEAD_TIME_S = 1.5


def resting_state(parameters: Parameters, configuration: np.ndarray) -> State:
    """The machine at rest: engine running, spools centred, chambers carrying gravity.

    Args:
        configuration: joint angles, (n,), rad, within the mechanical stops.

    Raises:
        InputError: the configuration lies outside the stops.
    """
    q = np.array(configuration, dtype=np.float64)
    n = q.size
    linkage = parameters.linkage
    if np.any(q < linkage.lower_rad) or np.any(q > linkage.upper_rad):
        raise InputError(
            f"start configuration {q.tolist()} lies outside the stops {linkage.lower_rad.tolist()} .. "
            f"{linkage.upper_rad.tolist()} rad; choose angles within them"
        )
    torque = np.zeros(n)
    gravity_torque(parameters.links, q, torque)
    chamber = np.full((n, 2), 2.0 * parameters.supply.return_pressure_Pa)
    for j in range(n):
        grid = np.linspace(linkage.lower_rad[j], linkage.upper_rad[j], linkage.moment_arm_m.shape[1])
        force = torque[j] / np.interp(q[j], grid, linkage.moment_arm_m[j])
        area = parameters.cylinder.area_m2[j]
        # force = A+ p+ - A- p-, the unloaded chamber stays at its low pressure
        if force + area[NEGATIVE] * chamber[j, NEGATIVE] > area[POSITIVE] * chamber[j, POSITIVE]:
            chamber[j, POSITIVE] = (force + area[NEGATIVE] * chamber[j, NEGATIVE]) / area[POSITIVE]
        else:
            chamber[j, NEGATIVE] = (area[POSITIVE] * chamber[j, POSITIVE] - force) / area[NEGATIVE]
    n_ring = round(LONGEST_DEAD_TIME_S / parameters.numerics.substep_s)
    return State(
        angle_rad=q.copy(),
        velocity_rad_s=np.zeros(n),
        link_angle_rad=q.copy(),
        chamber_Pa=chamber,
        supply_Pa=np.array([2.0 * parameters.supply.return_pressure_Pa]),
        pilot_Pa=np.zeros((n, 2)),
        coil_warmth=np.zeros((n, 2)),
        pilot_activity=np.zeros(1),
        spool=np.zeros(n),
        spool_rest_s=np.zeros(n),
        silt_factor=np.ones(n),
        engine_speed=np.ones(1),
        disturbance=np.zeros(n + 2),
        line_volume_m3=np.zeros(n),
        oil_C=np.array([parameters.oil.start_C]),
        heat_J=np.zeros(1),
        command_ring=np.zeros((n_ring, n), dtype=np.int8),
        ring_index=np.zeros(1, dtype=np.int64),
        controller_command=np.zeros(n, dtype=np.int8),
        switches=np.zeros(N_SWITCH, dtype=np.int8),
        touches=np.zeros(1, dtype=np.int8),
        contacts=np.zeros(1, dtype=np.int64),
        energy_J=np.zeros(N_ENERGY),
        volume_m3=np.zeros(N_VOLUME),
    )
