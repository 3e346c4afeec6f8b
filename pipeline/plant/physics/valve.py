"""Pilot stage and main spools: from discrete commands to metering areas.

Chain per direction of motion: controller cycle, dead time, first-order build-up of pilot pressure; per
joint: the spool follows the difference of its two pilot pressures against a preloaded centring spring, with
a hysteresis band and a silt lock after rest (Merritt, sections 11-2 to 11-4 on spool forces and silting;
Jelali & Kroll, section 3.3 on spool dynamics, overlap and hysteresis).
"""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import NEGATIVE, POSITIVE, Pilot, Spool
from pipeline.plant.state import State


@compiled
def read_command(pilot: Pilot, state: State, command: np.ndarray, phase: int, dt: float) -> None:
    """Controller cycle: take over `command` (n,) once per cycle; store what was read for the dead time."""
    index = state.ring_index[0]
    cycle = max(round(pilot.controller_cycle_s / dt), 1)
    if (index + phase) % cycle == 0:
        state.controller_command[:] = command
    state.command_ring[index % state.command_ring.shape[0]] = state.controller_command
    state.ring_index[0] = index + 1


@compiled
def advance_pilots(pilot: Pilot, state: State, viscosity_ratio: float, dt: float) -> None:
    """One substep of all pilot pressures, coils and the pilot supply."""
    n, n_ring = state.spool.size, state.command_ring.shape[0]
    newest = state.ring_index[0] - 1
    slower = 1.0 - pilot.viscous_share + pilot.viscous_share * viscosity_ratio
    supplied = 1.0 - pilot.supply_sag * state.pilot_activity[0]
    n_active = 0
    for j in range(n):
        for d in range(2):
            delay = round(pilot.dead_time_s[j, d] / dt)
            asked = 0
            if newest >= delay:
                asked = state.command_ring[(newest - delay) % n_ring, j]
            on = asked == 1 if d == POSITIVE else asked == -1
            target = 0.0
            if on:
                n_active += 1
                noisy = 1.0 + pilot.noise_std * state.disturbance[j]
                faded = 1.0 - pilot.coil_fade[j, d] * state.coil_warmth[j, d]
                target = pilot.set_pressure_Pa[j, d] * noisy * faded * supplied
            rising = target > state.pilot_Pa[j, d]
            constant = pilot.rise_time_constant_s[j, d] if rising else pilot.fall_time_constant_s[j, d]
            state.pilot_Pa[j, d] += (target - state.pilot_Pa[j, d]) * dt / (constant * slower + dt)
            warmth = 1.0 if on else 0.0
            state.coil_warmth[j, d] += (warmth - state.coil_warmth[j, d]) * dt / pilot.coil_time_constant_s
    share = n_active / n
    state.pilot_activity[0] += (share - state.pilot_activity[0]) * dt / pilot.supply_time_constant_s


@compiled
def advance_spools(pilot: Pilot, spool: Spool, state: State, silt_draw: np.ndarray, dt: float) -> None:
    """One substep of all spool positions.

    Args:
        pilot: for the leakage between pilot lines.
        spool: spool quantities.
        state: changed in place.
        silt_draw: (n,) standard normal, the strength of a lock that begins now.
        dt: substep, s.
    """
    n = state.spool.size
    for j in range(n):
        pressure = state.pilot_Pa[j, POSITIVE] - state.pilot_Pa[j, NEGATIVE]
        for i in range(n):
            for e in range(2):
                if state.pilot_Pa[i, e] > 0.0:
                    pressure += pilot.crosstalk[j, POSITIVE, i, e] * state.pilot_Pa[i, e]
                    pressure -= pilot.crosstalk[j, NEGATIVE, i, e] * state.pilot_Pa[i, e]
        beyond = max(abs(pressure) - spool.preload_Pa, 0.0) / (spool.full_stroke_Pa - spool.preload_Pa)
        target = min(beyond, 1.0) * (1.0 if pressure > 0.0 else -1.0)

        half_band = 0.5 * spool.hysteresis
        distance = target - state.spool[j]
        if state.spool[j] == 0.0 and abs(target) > 0.0:
            grown = 1.0 - np.exp(-state.spool_rest_s[j] / spool.silt_time_constant_s)
            lock = spool.silt_pressure_Pa[j] * grown * state.silt_factor[j]
            if abs(pressure) < spool.preload_Pa + lock:
                state.spool_rest_s[j] += dt
                continue
        if target == 0.0 and abs(state.spool[j]) < half_band:
            if state.spool[j] != 0.0:  # centred by its spring: a new rest begins
                state.spool[j] = 0.0
                state.spool_rest_s[j] = 0.0
                state.silt_factor[j] = max(1.0 + spool.silt_spread * silt_draw[j], 0.0)
            else:
                state.spool_rest_s[j] += dt
            continue
        if abs(distance) > half_band:
            aim = target - half_band if distance > 0.0 else target + half_band
            if target == 0.0:
                aim = 0.0
            state.spool[j] += (aim - state.spool[j]) * dt / (spool.time_constant_s + dt)


@compiled
def opening(spool: Spool, joint: int, direction: int, stroke: float) -> float:
    """Share of the metering area that `stroke` towards `direction` opens: overlap, then a notch."""
    if stroke <= spool.overlap[joint, direction]:
        return 0.0
    return (
        (stroke - spool.overlap[joint, direction]) / (1.0 - spool.overlap[joint, direction])
    ) ** spool.notch_exponent


@compiled
def bypass_area(spool: Spool, stroke: float) -> float:
    """Open-centre area of one section at |stroke|: closes quadratically (a round land)."""
    closed = min(stroke / spool.bypass_close_stroke, 1.0)
    return (
        spool.bypass_closed_area_m2
        + (spool.bypass_open_area_m2 - spool.bypass_closed_area_m2) * (1.0 - closed) ** 2
    )


@compiled
def orifice(pressure_drop: float, quadratic: float, laminar: float) -> tuple[float, float]:
    """Flow through a sharp-edged orifice in series with a laminar line, and its slope.

    Solves Δp = quadratic·Q² + laminar·Q, with quadratic = ρ/(2 C_d² A²) (Merritt, section 3-2) and laminar by
    Hagen-Poiseuille (Merritt, section 3-3). Smooth and invertible through Δp = 0.

    Returns:
        Flow, m³/s, with the sign of `pressure_drop` (Pa), and dQ/dΔp.
    """
    root = np.sqrt(laminar * laminar + 4.0 * quadratic * abs(pressure_drop))
    return 2.0 * pressure_drop / (laminar + root), 1.0 / root
