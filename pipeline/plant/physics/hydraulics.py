"""Pump, valve block and chambers: one linearly implicit substep of all pressures.

Unknowns are the supply pressure and two chamber pressures per joint. Continuity of each volume (Merritt,
section 3-5): (V/β) dp/dt = Σ Q - A ẋ. All flows are linearised about the present pressures and taken at the
new ones (Rosenbrock-Euler), which is stable for the stiff relief valve and metering edges at millisecond
steps and, because every flow enters both of its volumes alike, conserves volume exactly. Chambers couple only
through the supply, so the system is solved by eliminating 2x2 blocks.
"""

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.parameters import NEGATIVE, POSITIVE, Parameters
from pipeline.plant.physics.oil import effective_bulk_modulus
from pipeline.plant.physics.valve import bypass_area, opening, orifice
from pipeline.plant.scratch import Scratch
from pipeline.plant.state import (
    BYPASSED,
    CONSUMED,
    DELIVERED,
    OTHERS,
    PUMP,
    RELIEVED,
    STORED,
    THROTTLED,
    State,
)


@compiled
def _cushion_area(parameters: Parameters, joint: int, direction: int, angle: float) -> float:
    """Outlet area of the cushion at `angle` for motion in `direction`: a tapered spear; infinite outside."""
    cylinder, linkage = parameters.cylinder, parameters.linkage
    remaining = (
        linkage.upper_rad[joint] - angle if direction == POSITIVE else angle - linkage.lower_rad[joint]
    )
    zone = cylinder.cushion_zone_rad[joint, direction]
    if zone <= 0.0 or remaining >= zone:
        return np.inf
    share = max(remaining, 0.0) / zone
    least = cylinder.cushion_area_m2[joint, direction]
    return least + (cylinder.cushion_open_area_m2 - least) * share**4


@compiled
def _line_resistance(parameters: Parameters, state: State, joint: int, viscosity_ratio: float) -> float:
    """Laminar resistance of one work line with its clogging and kink, Pa s/m³."""
    cylinder = parameters.cylinder
    resistance = cylinder.line_resistance_Pa_s_m3[joint] * viscosity_ratio
    resistance *= 1.0 + cylinder.line_clogging_per_m3[joint] * state.line_volume_m3[joint]
    source = int(cylinder.kink_source[joint])
    if source >= 0:
        beyond = cylinder.kink_side[joint] * (state.link_angle_rad[source] - cylinder.kink_onset_rad[joint])
        resistance += cylinder.kink_resistance_Pa_s_m3_rad[joint] * max(beyond, 0.0)
    return resistance


@compiled
def advance_pressures(
    parameters: Parameters,
    state: State,
    scratch: Scratch,
    viscosity: float,
    dt: float,
) -> None:
    """One substep of supply and chamber pressures, engine speed, heat, and energy and volume accounts.

    Args:
        state: changed in place.
        scratch: work arrays; travel and piston speed are read.
        viscosity: dynamic viscosity, Pa s.
        dt: substep, s.
    """
    spool, supply, cylinder, oil = parameters.spool, parameters.supply, parameters.cylinder, parameters.oil
    n = state.spool.size
    ratio = viscosity / oil.reference_viscosity_Pa_s
    edge = oil.density_kg_m3 / (2.0 * spool.discharge_coefficient**2)  # quadratic coefficient times area²
    tank = supply.return_pressure_Pa
    p_supply = state.supply_Pa[0]

    q_in, k_in = scratch.inlet[:, :, 0], scratch.inlet[:, :, 1]
    q_out, k_out = scratch.outlet[:, :, 0], scratch.outlet[:, :, 1]
    q_cross, k_cross = scratch.cross[:, 0], scratch.cross[:, 1]
    constant, slope = scratch.solution[:, :, 0], scratch.solution[:, :, 1]
    stiffness, travel, piston_speed = scratch.stiffness, scratch.travel, scratch.piston_speed
    scratch.inlet[:] = 0.0
    scratch.outlet[:] = 0.0
    bypass_series = 0.0
    for j in range(n):
        stroke = abs(state.spool[j])
        bypass_series += 1.0 / bypass_area(spool, stroke) ** 2
        direction = POSITIVE if state.spool[j] > 0.0 else NEGATIVE
        other = 1 - direction
        open_share = opening(spool, j, direction, stroke)
        if open_share > 0.0:
            line = _line_resistance(parameters, state, j, ratio)
            drop = p_supply - state.chamber_Pa[j, direction]
            if drop > 0.0:  # load check valve
                area = spool.inlet_area_m2[j, direction] * open_share
                q_in[j, direction], k_in[j, direction] = orifice(drop, edge / area**2, line)
            area = spool.outlet_area_m2[j, direction] * open_share
            cushion = _cushion_area(parameters, j, direction, state.angle_rad[j])
            quadratic = edge / area**2 + edge / cushion**2
            q_out[j, other], k_out[j, other] = orifice(state.chamber_Pa[j, other] - tank, quadratic, line)
        full = parameters.linkage.travel_m[j, -1]
        for d in range(2):
            pressure = state.chamber_Pa[j, d]
            leak = cylinder.tank_leakage_m3[j, d] / viscosity
            q_out[j, d] += leak * (pressure - tank)
            k_out[j, d] += leak
            if pressure < tank:  # make-up check valve
                q_out[j, d] += cylinder.make_up_gain_m3_s_Pa * (pressure - tank)
                k_out[j, d] += cylinder.make_up_gain_m3_s_Pa
            elif pressure > cylinder.port_relief_Pa:
                q_out[j, d] += supply.relief_gain_m3_s_Pa * (pressure - cylinder.port_relief_Pa)
                k_out[j, d] += supply.relief_gain_m3_s_Pa
            swept = travel[j] if d == POSITIVE else full - travel[j]
            volume = cylinder.dead_volume_m3[j, d] + cylinder.area_m2[j, d] * swept
            modulus = effective_bulk_modulus(
                oil.bulk_modulus_Pa, oil.hose_modulus_Pa[j], oil.air_fraction[j], pressure
            )
            stiffness[j, d] = volume / (modulus * dt)
        k_cross[j] = cylinder.cross_leakage_m3[j] / viscosity
        q_cross[j] = k_cross[j] * (state.chamber_Pa[j, POSITIVE] - state.chamber_Pa[j, NEGATIVE])

    # supply: pump, slip, open-centre bypass, relief
    k_slip = supply.pump_leakage_m3 / viscosity
    q_bypass, k_bypass = orifice(
        p_supply - tank, edge * bypass_series, cylinder.line_resistance_Pa_s_m3[0] * ratio
    )
    crack = supply.relief_pressure_Pa * (1.0 + supply.relief_wander_std * state.disturbance[n + 1])
    q_relief, k_relief = 0.0, 0.0
    if p_supply > crack:
        q_relief, k_relief = supply.relief_gain_m3_s_Pa * (p_supply - crack), supply.relief_gain_m3_s_Pa
    speed = state.engine_speed[0] * (1.0 + supply.ripple_std * state.disturbance[n])
    q_pumped = supply.pump_flow_m3_s * speed
    q_ideal = q_pumped * (1.0 - supply.others_share * state.switches[OTHERS])  # left for the arm
    modulus = effective_bulk_modulus(
        oil.bulk_modulus_Pa, supply.hose_modulus_Pa, oil.air_fraction[0], p_supply
    )
    c_supply = supply.volume_m3 / (modulus * dt)
    diagonal = c_supply + k_slip + k_bypass + k_relief
    right = q_ideal - k_slip * p_supply - q_bypass - q_relief

    # eliminate chambers: [a -k; -k b] δ = rest + k_in δs
    for j in range(n):
        a = stiffness[j, POSITIVE] + k_in[j, POSITIVE] + k_out[j, POSITIVE] + k_cross[j]
        b = stiffness[j, NEGATIVE] + k_in[j, NEGATIVE] + k_out[j, NEGATIVE] + k_cross[j]
        k = k_cross[j]
        r_a = (
            q_in[j, POSITIVE]
            - q_out[j, POSITIVE]
            - q_cross[j]
            - cylinder.area_m2[j, POSITIVE] * piston_speed[j]
        )
        r_b = (
            q_in[j, NEGATIVE]
            - q_out[j, NEGATIVE]
            + q_cross[j]
            + cylinder.area_m2[j, NEGATIVE] * piston_speed[j]
        )
        determinant = a * b - k * k
        constant[j, POSITIVE] = (b * r_a + k * r_b) / determinant
        constant[j, NEGATIVE] = (a * r_b + k * r_a) / determinant
        slope[j, POSITIVE] = (b * k_in[j, POSITIVE] + k * k_in[j, NEGATIVE]) / determinant
        slope[j, NEGATIVE] = (a * k_in[j, NEGATIVE] + k * k_in[j, POSITIVE]) / determinant
        for d in range(2):
            diagonal += k_in[j, d] * (1.0 - slope[j, d])
            right += -q_in[j, d] + k_in[j, d] * constant[j, d]
    change = right / diagonal

    # new pressures and the accounts, with the flows that were really taken
    q_bypass += k_bypass * change
    q_relief += k_relief * change
    q_pump = q_ideal - k_slip * (p_supply + change)
    new_supply = p_supply + change
    throttled = (
        q_bypass * (new_supply - tank) + q_relief * (new_supply - tank) + (q_ideal - q_pump) * new_supply
    )
    returned = q_bypass + q_relief
    consumed = 0.0
    for j in range(n):
        difference = state.chamber_Pa[j, POSITIVE] - state.chamber_Pa[j, NEGATIVE]
        for d in range(2):
            delta = constant[j, d] + slope[j, d] * change
            inlet = q_in[j, d] + k_in[j, d] * (change - delta)
            outlet = q_out[j, d] + k_out[j, d] * delta
            state.chamber_Pa[j, d] += delta
            throttled += inlet * (new_supply - state.chamber_Pa[j, d]) + outlet * (
                state.chamber_Pa[j, d] - tank
            )
            consumed += inlet
            returned += outlet
            state.line_volume_m3[j] += max(inlet, 0.0) * dt
        new_difference = state.chamber_Pa[j, POSITIVE] - state.chamber_Pa[j, NEGATIVE]
        throttled += (q_cross[j] + k_cross[j] * (new_difference - difference)) * new_difference
    state.supply_Pa[0] = new_supply
    throttled += returned * tank  # the return line's back pressure
    state.energy_J[PUMP] += q_ideal * new_supply * dt
    state.energy_J[THROTTLED] += throttled * dt
    state.heat_J[0] += throttled * dt
    state.volume_m3[DELIVERED] += q_pump * dt
    state.volume_m3[BYPASSED] += q_bypass * dt
    state.volume_m3[RELIEVED] += q_relief * dt
    state.volume_m3[CONSUMED] += consumed * dt
    state.volume_m3[STORED] += c_supply * change * dt

    load = q_pumped * new_supply / supply.engine_power_W  # assumed: other functions work at the same pressure
    target = 1.0 - supply.engine_droop * load
    state.engine_speed[0] += (target - state.engine_speed[0]) * dt / supply.engine_time_constant_s
