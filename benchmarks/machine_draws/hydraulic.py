"""Machines of the plant whose constants are all drawn: other valves, pumps, oils, pilots and encoders on one arm.

The arm's geometry, limits and cylinders are those of the machine's description, which learners are given. Ranges are
those of the sources named beside the values of `pipeline/plant/machines/bobcat_e10.py`. Where it names none, the range
is assumed, about the nominal value. What only effects change stays neutral. A draw is kept if its full speeds and rise
times are the contract's (section 1); else the next one is tried.
"""

from collections.abc import Callable

import numpy as np

from pipeline.plant.machines.bobcat_e10 import BAR, LITRE_PER_MINUTE, MM2
from pipeline.plant.machines.characterise import full_speeds, rise_time
from pipeline.plant.parameters import Parameters

SPEED_RAD_S = (0.25, 0.70)  # contract, section 1: full command
RISE_S = (0.4, 1.0)  # contract, section 1: from command to 90 % of speed
MAXIMUM_DRAWS = 100

VISCOSITY_40C_100C_CST = ((32.0, 5.4), (46.0, 6.8), (68.0, 8.7))
"""ISO 3448 grades VG 32, 46 and 68 with viscosity index 100 (ASTM D2270)."""

# Lower and upper bound of one value per machine.
ONE: dict[str, dict[str, tuple[float, float]]] = {
    "pilot": {
        "controller_cycle_s": (0.005, 0.020),
        "viscous_share": (0.2, 0.4),
        "noise_std": (0.010, 0.030),
        "noise_correlation_s": (0.2, 0.8),
    },
    "spool": {
        "preload_Pa": (4.5 * BAR, 6.0 * BAR),
        "full_stroke_Pa": (22.0 * BAR, 26.0 * BAR),
        "time_constant_s": (0.010, 0.025),
        "hysteresis": (0.02, 0.04),  # Jelali & Kroll, section 3.3
        "silt_time_constant_s": (1.0, 4.0),
        "silt_spread": (0.2, 0.4),
        "notch_exponent": (1.0, 1.4),
        "bypass_open_area_m2": (30.0 * MM2, 50.0 * MM2),
        "bypass_closed_area_m2": (1.8 * MM2, 2.6 * MM2),
        "bypass_close_stroke": (0.40, 0.50),
        "discharge_coefficient": (0.60, 0.70),  # Merritt, section 3-2
    },
    "supply": {
        "pump_flow_m3_s": (19.0 * LITRE_PER_MINUTE, 23.0 * LITRE_PER_MINUTE),
        "pump_leakage_m3": (3.0e-14, 1.2e-13),  # volumetric efficiency 0.90 to 0.97 at 100 bar warm
        "relief_pressure_Pa": (165.0 * BAR, 195.0 * BAR),
        "relief_gain_m3_s_Pa": (
            21.0 * LITRE_PER_MINUTE / (18.0 * BAR),
            21.0 * LITRE_PER_MINUTE / (8.0 * BAR),
        ),
        "volume_m3": (0.4e-3, 1.0e-3),
        "hose_modulus_Pa": (1.2e9, 3.0e9),
        "return_pressure_Pa": (2.0 * BAR, 4.0 * BAR),
        "engine_droop": (0.05, 0.08),  # mechanical governors
        "engine_time_constant_s": (0.15, 0.40),
        "ripple_std": (0.006, 0.016),
        "ripple_correlation_s": (3.0, 12.0),
    },
    "friction": {"stribeck_speed_m_s": (0.005, 0.020)},
    "oil": {
        "density_kg_m3": (850.0, 890.0),
        "bulk_modulus_Pa": (1.2e9, 1.7e9),
        "heat_capacity_J_K": (4.0e4, 7.0e4),
        "heat_loss_W_K": (35.0, 60.0),
        "ambient_C": (0.0, 30.0),
        "start_C": (45.0, 60.0),
    },
    "sensor": {
        "noise_std_rad": (2.5e-4, 6.0e-4),
        "stamp_jitter_s": (0.001, 0.004),
        "drop_probability": (0.0, 0.005),
        "command_jitter_s": (0.001, 0.005),
    },
}

# Largest factor, or its inverse, of each value about the nominal one: (of the machine, of each value on top).
FACTOR: dict[str, dict[str, tuple[float, float]]] = {
    "pilot": {
        "dead_time_s": (1.3, 1.15),
        "set_pressure_Pa": (1.04, 1.03),
        "rise_time_constant_s": (1.3, 1.15),
        "fall_time_constant_s": (1.3, 1.15),
    },
    "spool": {
        "overlap": (1.1, 1.2),
        "silt_pressure_Pa": (1.5, 1.2),
        "inlet_area_m2": (1.1, 1.15),
        "outlet_area_m2": (1.1, 1.15),
    },
    "cylinder": {
        "dead_volume_m3": (1.3, 1.15),  # hoses of 1.4 to 3 m
        "line_resistance_Pa_s_m3": (1.6, 1.15),  # bores of 7 to 9 mm, to the power of four
        "cross_leakage_m3": (2.0, 1.5),
        "tank_leakage_m3": (2.0, 1.5),
        "make_up_gain_m3_s_Pa": (1.5, 1.0),
        "cushion_zone_rad": (1.3, 1.2),
        "cushion_area_m2": (1.5, 1.2),
        "cushion_open_area_m2": (1.3, 1.0),
    },
    "linkage": {"play_rad": (1.5, 1.3)},
    "links": {"turret_inertia_kg_m2": (1.2, 1.0)},
    "friction": {
        "coulomb_N": (1.3, 1.1),  # 2 to 4 % of the force at 100 bar
        "static_ratio": (1.1, 1.05),
        "viscous_N_s_m": (1.3, 1.15),
        "pin_Nm": (1.3, 1.15),
    },
    "oil": {"hose_modulus_Pa": (1.4, 1.15), "air_fraction": (2.0, 1.2)},
}

MASS_FACTOR, CENTRE_FACTOR = 1.1, 1.05  # of each link, its inertia with its mass
PORT_RELIEF_ABOVE_Pa = (30.0 * BAR, 50.0 * BAR)  # anti-shock valves open above the main relief valve
ENCODER_BITS = (12, 14)


def draw_hydraulic(nominal: Parameters, seed: int) -> Parameters:
    """The first machine of the seed's draws that moves as the contract says.

    Args:
        nominal: Machine of the same geometry.
        seed: Of all constants.

    Raises:
        RuntimeError: None of `MAXIMUM_DRAWS` does.
    """
    random = np.random.default_rng(seed)
    for _ in range(MAXIMUM_DRAWS):
        drawn = _draw(nominal, random)
        if _is_of_the_class(drawn):
            return drawn
    raise RuntimeError(f"seed {seed}: none of {MAXIMUM_DRAWS} machines moves as the contract says")


def _draw(nominal: Parameters, random: np.random.Generator) -> Parameters:
    drawn = nominal
    for part, bounds in ONE.items():
        drawn = drawn.change(part, **{name: random.uniform(*pair) for name, pair in bounds.items()})
    for part, factors in FACTOR.items():
        present = getattr(nominal, part)
        values = {}
        for name, (of_machine, of_each) in factors.items():
            value = getattr(present, name)
            factor = _factor(random, of_machine) * _factor(random, of_each, np.shape(value))
            values[name] = value * factor if np.ndim(value) else float(value * factor)
        drawn = drawn.change(part, **values)
    return _with_dependent(drawn, random)


def _with_dependent(drawn: Parameters, random: np.random.Generator) -> Parameters:
    """Values that are bound to one another: weights, valves, the oil's grade, the encoders' bits."""
    links = drawn.links
    mass = _factor(random, MASS_FACTOR, links.mass_kg.shape)
    drawn = drawn.change(
        "links",
        mass_kg=links.mass_kg * mass,
        inertia_kg_m2=links.inertia_kg_m2 * mass,
        centre_m=links.centre_m * _factor(random, CENTRE_FACTOR, links.centre_m.shape),
    )
    above = random.uniform(*PORT_RELIEF_ABOVE_Pa)
    drawn = drawn.change("cylinder", port_relief_Pa=drawn.supply.relief_pressure_Pa + above)
    a, b = walther(*VISCOSITY_40C_100C_CST[random.integers(len(VISCOSITY_40C_100C_CST))])
    drawn = drawn.change("oil", walther_a=a, walther_b=b)
    bits = random.integers(ENCODER_BITS[0], ENCODER_BITS[1], endpoint=True)
    return drawn.change("sensor", quantum_rad=2.0 * np.pi / 2.0**bits)


def walther(at_40C_cSt: float, at_100C_cSt: float) -> tuple[float, float]:
    """Constants a and b of the Walther equation (ASTM D341), see `Oil`, from two kinematic viscosities."""
    at_40, at_100 = (np.log10(np.log10(viscosity + 0.7)) for viscosity in (at_40C_cSt, at_100C_cSt))
    b = (at_40 - at_100) / np.log10(373.15 / 313.15)
    return float(at_40 + b * np.log10(313.15)), float(b)


def _factor(random: np.random.Generator, largest: float, shape: tuple[int, ...] = ()) -> np.ndarray:
    """Log-uniform between the inverse of `largest` and `largest`."""
    return np.exp(np.log(largest) * random.uniform(-1.0, 1.0, shape))


def _is_of_the_class(drawn: Parameters) -> bool:
    """Whether full speeds and rise times are the contract's; speeds first, which most draws fail at."""
    speeds = full_speeds(drawn)
    if not _within(speeds, SPEED_RAD_S):
        return False
    measures: list[Callable[[int], float]] = [
        lambda joint: rise_time(drawn, joint, -1),
        lambda joint: rise_time(drawn, joint, 1),
    ]
    return all(
        _within(np.array(measure(joint)), RISE_S) for joint in range(len(speeds)) for measure in measures
    )


def _within(values: np.ndarray, bounds: tuple[float, float]) -> bool:
    return bool(np.all((values >= bounds[0]) & (values <= bounds[1])))
