"""`thermal_drift`: the session starts with cold oil, in filters and lines that react to viscosity."""

import numpy as np
from scipy.optimize import curve_fit

from pipeline.plant.effects.effect import PlantEffect, Quantity
from pipeline.plant.machines.bobcat_e10 import JOINT_NAMES
from pipeline.plant.machines.characterise import MIDDLE_RAD, full_speeds, in_the_air
from pipeline.plant.parameters import Parameters
from pipeline.plant.simulator import Plant

# The oil's start temperature does not depend on the size. Above 20 degrees, reduced leakage compensates for the losses
# in the lines, so that cold oil only delays starts.
COLDEST_C, WARMEST_C = 8.0, 16.0
# Cold-sensitive lines: blocked line filters have laminar resistance. The factor makes the loss of speed grow evenly
# with the cold, with a few percent left in warm oil. (Nominal lines slow only below 15 degrees, and then abruptly.)
# It is scaled with the size; otherwise a small effect would consist mainly of the part that remains in warm oil.
LINE_FACTOR = 20.0
FASTEST_S, SLOWEST_S = (
    1200.0,
    3600.0,
)  # of the oil without work: speeds recover within one to four minutes of work
WATCHED_S = 720.0  # of work, in which the oil warms itself
STEP_S = 15.0
SLOWEST_DECAY = 10.0  # times the watched duration; a slower recovery would outlast a shift
HOLD_S = 1.5
N_TEMPERATURES = 8


def draw(random: np.random.Generator, nominal: Parameters, size: float) -> PlantEffect:
    """Cold start on a day as cold as the oil, with laminar restrictions in the work lines."""
    start_C = random.uniform(COLDEST_C, WARMEST_C)
    warm_up_s = random.uniform(FASTEST_S, SLOWEST_S)

    def apply(parameters: Parameters) -> Parameters:
        lines = parameters.cylinder.line_resistance_Pa_s_m3 * (1.0 + size * (LINE_FACTOR - 1.0))
        return parameters.change(
            "oil", start_C=start_C, heat_capacity_J_K=parameters.oil.heat_loss_W_K * warm_up_s
        ).change("cylinder", line_resistance_Pa_s_m3=lines)

    loss, time_constant_s = _of_speed(apply(nominal))
    truth = {
        "cold_speed_loss": Quantity(float(np.mean(loss)), "1"),
        "time_constant": Quantity(time_constant_s, "s"),
        "oil_time_constant": Quantity(warm_up_s, "s"),
    }
    truth |= {f"cold_speed_loss:{n}": Quantity(float(loss[j]), "1") for j, n in enumerate(JOINT_NAMES)}
    return PlantEffect(
        "thermal_drift", "thermal_drift", JOINT_NAMES, ("time_since_start",), truth, "cold oil", apply
    )


def _of_speed(cold: Parameters) -> tuple[np.ndarray, float]:
    """The declared truth: the exponential nearest to the recovery of speed, which is faster than the oil's warming.

    Viscosity falls steeply with temperature, so most of the loss is gone while the oil is still cold. Work heats the
    oil.

    Returns:
        Loss of speed at the start, (n_joint,), and the time constant of its mean over all joints, s.
    """
    time_s, oil_C = _at_work(cold)
    tried_C = np.linspace(oil_C.min(), oil_C.max(), N_TEMPERATURES)
    speeds = np.stack([full_speeds(cold.change("oil", start_C=c)).mean(axis=1) for c in tried_C])
    loss = np.stack([1.0 - np.interp(oil_C, tried_C, of / of[-1]) for of in speeds.T], axis=1)

    def decay(t: np.ndarray, initial: float, time_constant_s: float) -> np.ndarray:
        return initial * np.exp(-t / time_constant_s)

    mean = loss.mean(axis=1)
    # Bounded: where speeds hardly recover, the nearest exponential would be a straight line without end.
    (_, time_constant_s), _ = curve_fit(
        decay,
        time_s,
        mean,
        p0=(max(float(mean[0]), 1e-3), 0.2 * WATCHED_S),
        bounds=([0.0, STEP_S], [1.0, SLOWEST_DECAY * WATCHED_S]),
    )
    shape = decay(time_s, 1.0, time_constant_s)
    return shape @ loss / (shape @ shape), float(time_constant_s)


def _at_work(parameters: Parameters) -> tuple[np.ndarray, np.ndarray]:
    """Times, s, and the oil's temperature, while one joint after the other goes back and forth."""
    plant = Plant(in_the_air(parameters), 0, np.array(MIDDLE_RAD))
    dt_s = parameters.numerics.control_period_s
    hold = round(HOLD_S / dt_s)
    pattern = np.concatenate(
        [
            np.tile(sign * np.eye(plant.n_joint)[joint], (hold, 1))
            for joint in range(plant.n_joint)
            for sign in (1, -1)
        ]
    )
    n_step = round(STEP_S / dt_s)
    commands = np.tile(pattern, (round(WATCHED_S / dt_s) // len(pattern) + 1, 1))
    oil_C = []
    for first in range(0, round(WATCHED_S / dt_s), n_step):
        oil_C.append(float(plant.state.oil_C[0]))
        plant.run(commands[first : first + n_step])
    return STEP_S * np.arange(len(oil_C)), np.array(oil_C)
