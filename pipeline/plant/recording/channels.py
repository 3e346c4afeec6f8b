"""What the machine records beside joint states and commands: oil temperature, pump pressure, engine speed.

Each is measured with a first-order lag, noise and a resolution, and published at its own rate. Random numbers come from
a stream of their own, so that joint states and commands do not depend on these sensors.

The machine's sensors are not published. Noise and resolution follow common ones; lags, rates and delays are assumed:

- Oil temperature: a platinum thermometer of class A is within 0.2 K at 25 °C (IEC 60751), taken for the noise. The lag
  of 8 s is assumed for its sleeve, the resolution of 0.1 °C for its display.
- Pump pressure: 12 bits over 400 bar are 0.1 bar. The noise of 1 bar is a quarter per cent of that range, within a
  transducer's class of 0.5 %. The lag of 20 ms is assumed for an input filter.
- Engine speed: noise, lag and the resolution of 1 rpm are assumed.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.plant.simulator import Plant

PASCAL_PER_BAR = 1e5
RATED_ENGINE_RPM = 2000.0  # assumed, of the E10's class
PUBLICATION_DELAY_S = (0.001, 0.005)  # assumed: least and largest, uniform


@dataclass(frozen=True)
class ChannelSensor:
    """One sensor. Noise and resolution are in the channel's unit.

    Attributes:
        time_constant_s: Of its first-order lag.
        noise_std: Standard deviation, before rounding.
        resolution: One count.
        n_period: Control periods between two messages.
    """

    time_constant_s: float
    noise_std: float
    resolution: float
    n_period: int


SENSORS = {
    "oil_temperature": ChannelSensor(
        time_constant_s=8.0, noise_std=0.2, resolution=0.1, n_period=20
    ),  # °C, in the tank
    "pump_pressure": ChannelSensor(time_constant_s=0.02, noise_std=1.0, resolution=0.1, n_period=1),  # bar
    "engine_speed": ChannelSensor(time_constant_s=0.1, noise_std=3.0, resolution=1.0, n_period=2),  # rpm
}


@dataclass(frozen=True)
class ChannelLog:
    """Messages of one channel: K log times, s since the start, and values in the channel's unit."""

    log_s: np.ndarray
    value: np.ndarray


def true_values(plant: Plant) -> np.ndarray:
    """Present oil temperature, °C, pump pressure, bar, and engine speed, rpm, shape (3,)."""
    state, ripple_std = plant.state, plant.parameters.supply.ripple_std
    ripple = 1.0 + ripple_std * state.disturbance[plant.n_joint]
    return np.array(
        [
            state.oil_C[0],
            state.supply_Pa[0] / PASCAL_PER_BAR,
            RATED_ENGINE_RPM * state.engine_speed[0] * ripple,
        ]
    )


def measure(true: np.ndarray, period_s: float, seed: int) -> dict[str, ChannelLog]:
    """Return what the sensors publish of true values at the start and the ends of T control periods.

    Args:
        true: Shape (T + 1, 3), columns as in `true_values`.
        period_s: The control period.
        seed: Of noise and delays.
    """
    logs = {}
    streams = np.random.SeedSequence(seed).spawn(len(SENSORS))
    for (name, sensor), exact, stream in zip(SENSORS.items(), true.T, streams, strict=True):
        random = np.random.default_rng(stream)
        followed = 1.0 - np.exp(-period_s / sensor.time_constant_s)
        lagged = np.empty_like(exact)
        lagged[0] = exact[0]
        for row in range(1, len(exact)):
            lagged[row] = lagged[row - 1] + followed * (exact[row] - lagged[row - 1])
        rows = np.arange(0, len(exact), sensor.n_period)
        noisy = lagged[rows] + sensor.noise_std * random.standard_normal(len(rows))
        logs[name] = ChannelLog(
            log_s=period_s * rows + random.uniform(*PUBLICATION_DELAY_S, len(rows)),
            value=np.round(noisy / sensor.resolution) * sensor.resolution,
        )
    return logs
