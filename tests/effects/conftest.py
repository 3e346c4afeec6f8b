"""A small machine, values of every family, and logs and models to try effects on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.kinds import build_model, read_specification
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.effect import Channel, CommandEffect, Setting, Signals
from pipeline.logs.tuples import Trajectory

DT_S = 0.05
LOWER, UPPER, SPEED = np.array([-1.0, 0.05]), np.array([0.5, 0.35]), np.array([0.5, 0.1])  # rad, m
PRESSURE = Channel("pressure", 50.0, 210.0, 120.0)
SETTING = Setting(DT_S, LOWER, UPPER, SPEED, (PRESSURE,))
LAGS = 3
WRAPPED = sorted(KNOWN)  # all families

# Far from neutral, and from the kinks of delays and clips.
VALUES = {
    "gain": {"ratio_positive": [1.3, 0.8], "ratio_negative": [0.7, 1.0]},
    "delay": {"added_delay": [0.13, 0.06]},
    "lag": {"added_time_constant": [0.12, -0.15]},
    "flow_coupling": {
        "loss_fraction": [[0.0, 0.35], [0.25, 0.0]],
        "loss_alone_positive": [0.1, 0.2],
        "loss_alone_negative": [0.15, 0.0],
    },
    "load": {
        "mean_speed_ratio_up": [0.8, 1.1],
        "mean_speed_ratio_down": [1.2, 0.9],
        "load_slope": [[0.1, 0.3], [0.0, -0.2]],
    },
    "thermal_drift": {
        "cold_speed_loss": [0.4, 0.2],
        "warm_gain": [0.1, 0.05],
        "cold_lag": [0.08, 0.12],
        "fall_share": [0.5, 0.5],
        "lag_time_ratio": [2.0, 2.0],
        "time_constant": [40.0, 40.0],
    },
    "leakage": {
        "sag_rate": [-0.04, 0.01],
        "share_in_positive_motion": [1.2, 0.0],
        "share_in_negative_motion": [0.3, 1.7],
    },
    "backlash": {"width": [0.03, 0.008]},
    "stiction": {"mean_extra_time": [0.13, 0.22], "rest_threshold": [0.31, 0.12]},
    "end_cushion": {"loss_upper": [0.6, 0.3], "loss_lower": [0.2, 0.0], "zone_share": [0.3, 0.4]},
    "sensor_bias": {"offset": [0.05, -0.01], "scale": [1.1, 0.9]},
    "timing": {"latency": [0.08, 0.08]},
    "oscillation": {"share": [1.0, 0.4], "frequency": [1.3, 2.1], "damping_ratio": [0.1, 0.3]},
    "other:dead_band": {
        "dead_band_negative": [0.3, 0.15],
        "dead_band_positive": [0.2, 0.4],
        "saturation_negative": [0.8, 0.9],
        "saturation_positive": [0.7, 0.95],
    },
}


def _coefficients(family: str) -> dict:
    shape = KNOWN[family](SETTING).neutral()["coefficients"].shape
    return {"coefficients": np.random.default_rng(5).uniform(-0.15, 0.15, shape)}


VALUES |= {family: _coefficients(family) for family in DEPENDENCES}
VALUES = {  # what is not named is neutral
    family: KNOWN[family](SETTING).neutral() | {name: np.array(value) for name, value in of.items()}
    for family, of in VALUES.items()
}


@pytest.fixture
def float64():
    """Double precision within a test, for comparisons with closed forms; the values for it."""
    used = vars(SETTING).copy()
    # JAX remembers, array by array, in which precision it made a NumPy array a constant: it must not be the same array.
    vars(SETTING).update({name: np.copy(used[name]) for name in ("lower", "upper", "speed_scale")})
    with jax.enable_x64(True):
        yield jax.tree.map(np.copy, VALUES)
    vars(SETTING).update(used)


def rows(seed: int, n_rows: int, batch: tuple = (), proportional: bool = False) -> tuple[np.ndarray, Signals]:
    """Velocities and signals of random holds and rests, (T, ..., 2), as NumPy arrays in float32."""
    random = np.random.default_rng(seed)
    shape = (n_rows, *batch, 2)
    command = np.zeros(shape)
    for t in range(1, n_rows):
        change = random.random((*batch, 2)) < 0.2
        command[t] = np.where(change, random.integers(-1, 2, (*batch, 2)), command[t - 1])
    if proportional:
        command *= random.uniform(0.3, 1.0, shape)
    u = SPEED * (0.9 * command + random.uniform(0.02, 0.08, shape) * random.choice([-1, 1], shape))
    q = LOWER + (UPPER - LOWER) * random.random(shape)
    time_s = np.broadcast_to((DT_S * np.arange(n_rows)).reshape(-1, *([1] * len(batch))), shape[:-1])
    pressure = random.uniform(PRESSURE.lower, PRESSURE.upper, (*shape[:-1], 1))
    single = [np.asarray(array, np.float32) for array in (u, command, q, time_s, pressure)]
    return single[0], Signals(*single[1:])


def signals_at(command=(0.0, 0.0), q=(0.0, 0.2), time_s=0.0) -> Signals:
    """One row."""
    return Signals(jnp.array(command), jnp.array(np.copy(q)), jnp.array(time_s))


def respond(effect, values, u, signals=None, step="apply") -> np.ndarray:
    """Outputs along rows (T, ..., n_joint) from rest, one call of the wrapper per row."""
    state, outputs = effect.initial(np.shape(u)[1:-1]), []
    one_row = jax.jit(getattr(effect, step))
    resting = signals_at()
    for t, row in enumerate(np.asarray(u)):
        if isinstance(effect, CommandEffect):
            state, output = one_row(values, state, row)
        else:
            of_row = jax.tree.map(lambda column, t=t: np.asarray(column)[t], signals)
            present = resting if signals is None else of_row
            state, output = one_row(values, state, row, present)
        outputs.append(output)
    return np.stack(outputs)


def make_model(
    parameterization="mlp", target="dqdot", hidden=(4,), lags=LAGS, scale=(0.02, 0.003)
) -> DynamicsModel:
    content = {
        "parameterization": parameterization,
        "target": target,
        "hidden": list(hidden),
        "lags": lags,
        "legendre_degree": 3,
        "joints": ["lift", "slide"],
        "rate_hz": 1 / DT_S,
        "position_lower": LOWER.tolist(),
        "position_upper": UPPER.tolist(),
        "velocity_limit": [0.7, 0.15],
        "residual_scale": list(scale),
    }
    if parameterization == "nfir":
        stops = {"stop_lower": LOWER.tolist(), "stop_upper": [None, *UPPER.tolist()[1:]]}
        content |= {"members": 2, "member_hidden": [3], "demand_beyond": [1]} | stops
    return build_model(read_specification(content))


def make_trajectory(q, qd, a, start_s=0.0, **channels) -> Trajectory:
    t_s = start_s + DT_S * np.arange(len(q))
    return Trajectory(
        name="log",
        t_s=t_s,
        stamp_ns=1_700_000_000_000_000_000 + np.round(1e9 * t_s).astype(np.int64),
        q=np.asarray(q, np.float64),
        qd=np.asarray(qd, np.float64),
        a=np.asarray(a, np.float64),
        is_validation=np.zeros(len(q), bool),
        channels=channels,
    )


def random_trajectory(seed: int, n_rows: int = 90) -> Trajectory:
    u, signals = rows(seed, n_rows)
    return make_trajectory(
        signals.q, u, signals.command, pressure=np.asarray(signals.channels[:, 0], np.float64)
    )
