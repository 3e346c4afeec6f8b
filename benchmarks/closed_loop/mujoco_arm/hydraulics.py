"""The compiled drives: from commands to the forces of the cylinders' rods. Equations: this package's docstring."""

import numpy as np

from benchmarks.closed_loop.mujoco_arm.quantities import N_SHARED, NEGATIVE, POSITIVE, SUPPLY
from benchmarks.closed_loop.unstored import compiled

SMALL_PRESSURE_Pa = 1e4  # below such drops an orifice is laminar, which makes its flow differentiable
THINNING_1_K = 0.03  # of oil's viscosity with temperature, about 50 °C
VISCOUS_SHARE = 0.3  # of a port's resistance with warm oil that grows with viscosity
MOST_PRESSURE = 2.0  # of the set one, at which a chamber's relief valve opens


@compiled
def rods(transmission: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where rods' pins are, from the middle of their strokes, and their levers.

    Args:
        transmission: (3, n), see `Arm.transmission`.
        position: (n,) of the joints, rad or m.

    Returns:
        (n,) m and (n,) m per rad, or 1 for prismatic joints.
    """
    place, lever = np.empty(position.size), np.empty(position.size)
    for j in range(position.size):
        off, middle, falls = position[j] - transmission[0, j], transmission[1, j], transmission[2, j]
        place[j] = middle * np.sin(falls * off) / falls if falls > 0.0 else middle * off
        lever[j] = middle * np.cos(falls * off)
    return place, lever


@compiled
def drive(
    quantity_record: np.recarray,
    state_record: np.recarray,
    commands: np.ndarray,
    arrival_s: np.ndarray,
    extra_share: np.ndarray,
    period: int,
    time_s: float,
    clock_s: float,
    transmission: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    dt_s: float,
    n_substep: int,
    torque: np.ndarray,
) -> None:
    """Run the drives for some substeps, while links go on as they do.

    Args:
        quantity_record: `Quantities` as one record.
        state_record: `State` as one record, changed in place.
        commands: (T, n) of the session; rows up to `period` are known.
        arrival_s: (T, n) when they reach the drivers, since the session's start.
        extra_share: (n,) of the mean extra time, for starts that begin to stick now.
        period: Number of the control period.
        time_s: Since the session's start.
        clock_s: Of the wall clock.
        transmission: (3, n), see `rods`.
        position: (n,) of the joints, rad or m.
        velocity: (n,) of the joints.
        dt_s: Of a substep.
        n_substep: How many.
        torque: Written: (n,) on the joints, mean over the substeps, N m or N.
    """
    quantities, state = quantity_record[0], state_record[0]
    supply, cylinder = quantities.supply, quantities.cylinder
    n = position.size
    rod_m, lever = rods(transmission, position)
    rod_m_s = lever * velocity
    set_Pa = supply.pressure_Pa * np.exp(supply.wander_std * state.process[SUPPLY])
    cold = supply.cold_K * np.exp(-time_s / supply.warm_up_s)
    thickness = 1.0 / (1.0 + VISCOUS_SHARE * (np.exp(THINNING_1_K * cold) - 1.0))
    torque[:] = 0.0
    for substep in range(n_substep):
        now_s = time_s + substep * dt_s
        demand = slope = 0.0
        for j in range(n):
            move_spool(
                quantities.valve,
                quantities.odd,
                state,
                commands,
                arrival_s,
                extra_share,
                period,
                now_s,
                dt_s,
                j,
            )
            area = opening(quantities.valve, quantities.odd, state, position, clock_s, j) * thickness
            along = POSITIVE if state.spool[j] >= 0.0 else NEGATIVE
            toward = 1.0 if along == POSITIVE else -1.0
            place = toward * rod_m[j]
            rest_m = cylinder.half_stroke_m[j] - place
            outlet = area
            if cylinder.cushion_m[j, along] > max(rest_m, 0.0):
                share = cylinder.cushion_share[j, along]
                outlet *= share + (1.0 - share) * max(rest_m, 0.0) / cylinder.cushion_m[j, along]
            inflow, inflow_slope, force = press(
                cylinder,
                supply.modulus_Pa[j],
                state,
                set_Pa,
                area,
                outlet,
                along,
                place,
                toward * rod_m_s[j],
                dt_s,
                j,
            )
            demand += inflow
            slope += inflow_slope
            torque[j] += lever[j] * (toward * force - cylinder.viscous_N_s_m[j] * rod_m_s[j]) / n_substep
        feed(supply, state, set_Pa, demand, slope, dt_s)


@compiled
def move_spool(valve, odd, state, commands, arrival_s, extra_share, period, now_s, dt_s, j):  # type: ignore[no-untyped-def]
    """Let a command arrive, and the spool of joint j follow it."""
    while state.arrived_period[j] < period and arrival_s[state.arrived_period[j] + 1, j] <= now_s:
        state.arrived_period[j] += 1
        state.command[j] = commands[state.arrived_period[j], j]
    command = state.command[j]
    sign = np.sign(command)
    if sign != 0.0:
        if state.rest_s[j] > valve.rest_threshold_s[j] and valve.mean_extra_time_s[j] > 0.0:
            state.stuck_s[j] = valve.mean_extra_time_s[j] * extra_share[j]
        if sign * state.sign[j] < 0.0:
            state.locked_s[j] = odd.lockout_s[j]
            state.held_s[j] = 0.0
        state.sign[j] = sign
        state.rest_s[j] = 0.0
        state.held_s[j] += dt_s
    else:
        state.rest_s[j] += dt_s
        state.held_s[j] = 0.0
    wanted = sign * max(abs(command) - valve.overlap[j], 0.0) / (1.0 - valve.overlap[j])
    if state.stuck_s[j] > 0.0 or state.locked_s[j] > 0.0:
        wanted = 0.0
    state.stuck_s[j] = max(state.stuck_s[j] - dt_s, 0.0)
    state.locked_s[j] = max(state.locked_s[j] - dt_s, 0.0)
    state.heat[j] += (1.0 - np.exp(-dt_s / odd.heat_s)) * (abs(command) - state.heat[j])
    state.spool[j] += (1.0 - np.exp(-dt_s / valve.time_constant_s[j])) * (wanted - state.spool[j])


@compiled
def opening(valve, odd, state, position, clock_s, j):  # type: ignore[no-untyped-def]
    """Conductance of joint j's ports, m³ / (s √Pa)."""
    side = POSITIVE if state.spool[j] >= 0.0 else NEGATIVE
    share = np.exp(valve.noise_std * state.process[N_SHARED + j])
    share *= 1.0 - odd.heat_loss[j] * state.heat[j]
    share *= 1.0 - odd.block_loss[j] * state.blocked[j]
    if state.held_s[j] > odd.hold_s:
        share *= 1.0 + odd.hold_boost[j]
    if clock_s % odd.timer_s < 0.5 * odd.timer_s:
        share *= 1.0 - odd.timer_loss[j]
    for i in range(position.size):
        if abs(state.command[i]) > 0.5:
            share *= 1.0 - odd.pull[j, i]
        if position[i] > odd.kink_at[i]:
            share *= 1.0 - odd.kink_loss[j, i]
    return valve.conductance[j, side] * abs(state.spool[j]) * share


@compiled
def orifice(conductance, drop_Pa):  # type: ignore[no-untyped-def]
    """Flow, m³/s, and its derivative with regard to the drop."""
    root = np.sqrt(abs(drop_Pa) + SMALL_PRESSURE_Pa)
    return conductance * drop_Pa / root, conductance * (0.5 * abs(drop_Pa) + SMALL_PRESSURE_Pa) / root**3


@compiled
def press(cylinder, modulus_Pa, state, set_Pa, area, outlet, along, place_m, rod_m_s, dt_s, j):  # type: ignore[no-untyped-def]
    """Pressures of joint j's chambers a substep later, by linearised implicit Euler; seen in the spool's direction.

    Returns:
        Flow from the supply, its derivative with regard to the supply's pressure, and the force on the link, N.
    """
    inlet_Pa, outlet_Pa = state.pressure_Pa[j, along], state.pressure_Pa[j, 1 - along]
    inflow, inflow_slope = orifice(area, state.supply_Pa[0] - inlet_Pa)
    outflow, outflow_slope = orifice(outlet, outlet_Pa)
    half_play = 0.5 * cylinder.play_m[j]
    ahead_m = state.gap_m[j] if along == POSITIVE else -state.gap_m[j]
    force = cylinder.area_m2[j] * (inlet_Pa - outlet_Pa)
    is_free = half_play > 0.0 and not (
        (ahead_m >= half_play and force >= 0.0) or (ahead_m <= -half_play and force <= 0.0)
    )
    piston_m_s = rod_m_s
    if is_free:  # a piston without mass keeps its chambers even, and goes as the flow does
        piston_m_s = 0.5 * (inflow + outflow) / cylinder.area_m2[j]
        ahead_m = min(max(ahead_m + (piston_m_s - rod_m_s) * dt_s, -half_play), half_play)
        state.gap_m[j] = ahead_m if along == POSITIVE else -ahead_m
    leak = cylinder.leakage_m3_s_Pa[j]
    lost = leak * (inlet_Pa - outlet_Pa)
    swept = cylinder.area_m2[j] * piston_m_s
    first = cylinder.dead_volume_m3[j] + cylinder.area_m2[j] * (cylinder.half_stroke_m[j] + place_m)
    second = cylinder.dead_volume_m3[j] + cylinder.area_m2[j] * (cylinder.half_stroke_m[j] - place_m)
    stiff, stiff_too = dt_s * modulus_Pa / first, dt_s * modulus_Pa / second
    inlet_Pa += stiff * (inflow - swept - lost) / (1.0 + stiff * (inflow_slope + leak))
    outlet_Pa += stiff_too * (swept + lost - outflow) / (1.0 + stiff_too * (outflow_slope + leak))
    if is_free:
        inlet_Pa = outlet_Pa = 0.5 * (inlet_Pa + outlet_Pa)
    inlet_Pa = min(max(inlet_Pa, 0.0), MOST_PRESSURE * set_Pa)  # make-up and relief valves
    outlet_Pa = min(max(outlet_Pa, 0.0), MOST_PRESSURE * set_Pa)
    state.pressure_Pa[j, along], state.pressure_Pa[j, 1 - along] = inlet_Pa, outlet_Pa
    return inflow, inflow_slope, cylinder.area_m2[j] * (inlet_Pa - outlet_Pa)


@compiled
def feed(supply, state, set_Pa, demand, slope, dt_s):  # type: ignore[no-untyped-def]
    """The supply's pressure a substep later."""
    asked = supply.gain_m3_s_Pa * (set_Pa - state.supply_Pa[0])
    flow = min(max(asked, 0.0), supply.flow_m3_s)
    if flow == asked:
        slope += supply.gain_m3_s_Pa
    stiff = dt_s * supply.modulus_Pa[0] / supply.volume_m3
    state.supply_Pa[0] = max(state.supply_Pa[0] + stiff * (flow - demand) / (1.0 + stiff * slope), 0.0)


@compiled
def vary(
    quantity_record: np.recarray, state_record: np.recarray, draw: np.ndarray, even: np.ndarray, dt_s: float
) -> None:
    """Advance the random processes, exactly, by one control period.

    Args:
        quantity_record: `Quantities` as one record.
        state_record: `State` as one record, changed in place.
        draw: (N_SHARED + n,) standard normal.
        even: (n,) even in [0, 1): whether episodes begin or end.
        dt_s: Of the period.
    """
    quantities, state = quantity_record[0], state_record[0]
    odd = quantities.odd
    for k in range(draw.size):
        correlation_s = quantities.supply.wander_correlation_s
        if k >= N_SHARED:
            correlation_s = quantities.valve.noise_correlation_s
        kept = np.exp(-dt_s / correlation_s)
        state.process[k] = kept * state.process[k] + np.sqrt(1.0 - kept * kept) * draw[k]
    for j in range(even.size):
        if state.blocked[j] > 0.0:
            if even[j] < dt_s / odd.block_s:
                state.blocked[j] = 0.0
        elif even[j] < dt_s / odd.block_s * odd.block_share / (1.0 - odd.block_share):
            state.blocked[j] = 1.0
