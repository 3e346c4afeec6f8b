"""The screen beside an encoder's error that is known: effects act on the true motion, between the true stops."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.discrepancy.diagnosis.scored_rows import rows_in_blocks
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation
from pipeline.discrepancy.selection.candidate import Candidate, Key
from pipeline.discrepancy.selection.screen import screen
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.delay import Delay
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.effects.lag import Lag
from pipeline.effects.sensor_bias import SensorBias
from tests.dynamics.conftest import make_fir_specification

LAGS, N_ROWS, DT_S, BLOCK_ROWS = 4, 2000, 0.05, 100
STOP, SPEED = np.ones(2), np.full(2, 0.5)
POSITION = "other:position"
ACTIVE = {"sensor_bias": {"offset": np.array([0.3, 0.0]), "scale": np.array([1.25, 1.0])}}
RATIO = 0.8
FLOOR = np.full(2, 1e-4)  # (rad/s)²


def machine() -> tuple[DiagnosisModel, np.ndarray, np.ndarray]:
    """A joint's velocity is the mean of its last commands; commands, and true positions up to the stops: (T, 2).

    SiLU(x) - SiLU(-x) = x makes a network linear.
    """
    random = np.random.default_rng(0)
    command = random.choice([-1.0, 0.0, 1.0], (N_ROWS // 10, 2)).repeat(10, axis=0)
    q = np.clip(1.1 * np.sin(0.05 * np.arange(N_ROWS)[:, None] + np.array([0.0, 1.0])), -0.99, 0.99)
    mean = np.concatenate([np.eye(2)] * LAGS + [np.zeros((2, 2))]) / LAGS
    both, ways = np.concatenate([np.eye(2), -np.eye(2)]), np.concatenate([np.eye(2), -np.eye(2)], axis=1)
    layers = {"layer_0": mean @ ways, "layer_1": both}
    f = {name: {"kernel": jnp.float32(of), "bias": jnp.zeros(of.shape[1])} for name, of in layers.items()}
    stops = {"stop_lower": (-STOP).tolist(), "stop_upper": STOP.tolist()}
    model = FirModel(make_fir_specification(1.0, SPEED, LAGS - 1, hidden=[4], **stops))
    return DiagnosisModel(model, f, np.ones((1, 1, 1))), command, q


def measured(of_velocity) -> Simulation:  # type: ignore[no-untyped-def]
    """A log of the machine, whose velocity is what `of_velocity` makes of the usual one, read by a faulty encoder."""
    model, command, q = machine()
    before = np.concatenate([np.zeros((LAGS - 1, 2)), command])
    u = SPEED * np.mean([before[lag : lag + N_ROWS] for lag in range(LAGS)], axis=0)
    room = [np.minimum((-STOP - q) / DT_S, 0.0), np.maximum((STOP - q) / DT_S, 0.0)]
    offset, scale = ACTIVE["sensor_bias"].values()
    velocity = scale * np.clip(of_velocity(u), *room)
    time_s = DT_S * np.arange(N_ROWS)
    stamp_ns = np.round(1e9 * time_s).astype(np.int64)
    columns = command, scale * q + offset, velocity, time_s, stamp_ns, np.arange(N_ROWS) >= LAGS
    return simulated(model, Sequences(*(column[None] for column in columns)))


def simulated(model: DiagnosisModel, sequences: Sequences) -> Simulation:
    effects = [Gain, Delay, Lag, KNOWN[POSITION], SensorBias]
    return Simulation(model, sequences, effects, Setting(DT_S, -STOP, STOP, SPEED))


def screened(simulation: Simulation, active: Hypothesis) -> dict[Key, Candidate]:
    is_used = simulation.sequences.is_row
    fold = np.broadcast_to(np.arange(N_ROWS) // BLOCK_ROWS % 2, is_used.shape)
    rows = rows_in_blocks(is_used, fold, np.ones((1, N_ROWS, 2), bool), FLOOR, BLOCK_ROWS)
    return {c.key: c for c in screen(simulation, active, rows)}


def test_a_gain_is_found_as_if_the_encoder_were_right() -> None:
    candidate = screened(measured(lambda u: np.array([RATIO, 1.0]) * u), Hypothesis(ACTIVE))["gain", 0, None]
    np.testing.assert_allclose(candidate.coefficients, RATIO - 1.0, atol=0.005)
    assert candidate.share > 0.99


def test_a_dependence_on_position_is_one_on_the_true_position() -> None:
    _, _, q = machine()
    candidate = screened(measured(lambda u: (1.0 - 0.2 * q) * u), Hypothesis(ACTIVE))[POSITION, 0, 0]
    assert candidate.share > 0.95


@pytest.mark.parametrize("beside", [{}, {"gain": {"ratio_positive": np.array([1.0, 0.7])}}])
@pytest.mark.parametrize("onset_row", [None, 900])
def test_what_the_full_hypothesis_predicts_is_fully_explained(beside: dict, onset_row: int | None) -> None:
    """Also beside an effect on the velocity, here of the other joint, and where the encoder failed in mid log.

    Then the lag is given what the stops have left of a velocity, and not quite all is explained.
    """
    neutral = Gain(Setting(DT_S, -STOP, STOP, SPEED)).neutral()
    active = {**ACTIVE, **{family: {**neutral, **of} for family, of in beside.items()}}
    simulation = measured(lambda u: u)
    sequences = simulation.sequences
    onsets = {} if onset_row is None else {("sensor_bias", 0): int(sequences.stamp_ns[0, onset_row])}
    if onset_row is not None:
        _, _, q = machine()
        is_early = (np.arange(N_ROWS) < onset_row)[:, None] * np.array([True, False])
        sequences = sequences._replace(q=np.where(is_early, q, sequences.q[0])[None])
    simulation = simulated(machine()[0], sequences)
    effect = simulation.effects["lag"]
    point = {"added_time_constant": 0.3, "fall_share": 1.0}
    lag = effect.neutral() | {
        name: np.array([value, effect.neutral()[name][1]]) for name, value in point.items()
    }
    velocity = simulation.velocities([Hypothesis({**active, "lag": lag}, onsets)])[0]
    simulation = simulated(machine()[0], sequences._replace(velocity=velocity))
    candidate = screened(simulation, Hypothesis(active, onsets))["lag", 0, None]
    assert candidate.point == point
    assert candidate.share == pytest.approx(1.0, abs=0.04 if beside or onsets else 1e-6)


def test_without_an_encoders_error_nothing_more_is_compiled() -> None:
    simulation = measured(lambda u: u)
    screened(simulation, NOMINAL)
    assert all(len(effects) == 1 for _, effects, _ in simulation._compiled)


def test_before_an_onset_an_effect_acts_on_what_all_others_left() -> None:
    simulation = measured(lambda u: u)
    setting = simulation.setting
    delay = {"added_delay": np.array([0.2, 0.0])}
    gain = {**Gain(setting).neutral(), "ratio_positive": np.array([0.5, 1.0])}
    lag = Hypothesis({"lag": {"added_time_constant": np.array([0.3, 0.0]), "fall_share": np.ones(2)}})
    onset = int(simulation.sequences.stamp_ns[0, 900])
    onsets = {("gain", 0): onset}
    left = np.moveaxis(simulation.velocities([Hypothesis({"delay": delay, "gain": gain}, onsets)])[0], 1, 0)
    found = simulation.velocities([replace(lag, onsets=onsets)], jnp.asarray(left, jnp.float32))[0]
    np.testing.assert_array_equal(found, simulation.velocities([lag], jnp.asarray(left, jnp.float32))[0])
