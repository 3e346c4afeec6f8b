"""Ring-down: frequency and damping of a decaying oscillation whose closed form is known, under encoder noise."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.families.ring_down import ring_down

DT_S, N_STOPS, N_MOVING, N_RESTING = 0.05, 60, 20, 60


def stops(frequencies_hz: np.ndarray, damping_ratio: float, noise: float) -> Sequences:
    """Moves and rests in turn; after each move the velocity rings down, at a frequency of its own."""
    random = np.random.default_rng(0)
    time_s = DT_S * np.arange(N_RESTING)
    velocity, command = [], []
    for frequency in frequencies_hz:
        omega = 2.0 * np.pi * frequency
        damped = omega * np.sqrt(1.0 - damping_ratio**2)
        ringing = (
            0.3 * np.exp(-damping_ratio * omega * time_s) * np.cos(damped * time_s + random.uniform(0, 6))
        )
        velocity += [np.full(N_MOVING, 0.3), ringing]
        command += [np.ones(N_MOVING), np.zeros(N_RESTING)]
    v = np.concatenate(velocity)
    angle_noise = noise * random.standard_normal(len(v) + 1)
    v = v + np.diff(angle_noise) / DT_S
    n = len(v)
    return Sequences(
        command=np.concatenate(command)[None, :, None],
        q=np.zeros((1, n, 1)),
        velocity=v[None, :, None],
        time_s=DT_S * np.arange(n)[None],
        stamp_ns=np.arange(n)[None],
        is_row=np.ones((1, n), bool),
    )


def found(sequences: Sequences):
    return ring_down(sequences, sequences.is_row, joint=0, dt_s=DT_S)


@pytest.mark.parametrize(("frequency", "damping_ratio"), [(1.2, 0.1), (2.0, 0.05), (3.0, 0.1)])
def test_frequency_and_damping_are_found_in_noise(frequency: float, damping_ratio: float) -> None:
    ring = found(stops(np.full(N_STOPS, frequency), damping_ratio, noise=3e-4))
    assert ring.frequency_hz == pytest.approx(frequency, rel=0.02)
    assert ring.damping_ratio == pytest.approx(damping_ratio, abs=0.02)
    assert abs(ring.frequency_hz - frequency) < 4.0 * ring.frequency_deviation_hz
    assert abs(ring.damping_ratio - damping_ratio) < 4.0 * ring.damping_deviation


@pytest.mark.parametrize(("damping_ratio", "noise"), [(0.15, 1e-3), (0.05, 2e-3)])
def test_a_coarse_encoder_does_not_hide_that_a_joint_rings(damping_ratio: float, noise: float) -> None:
    ring = found(stops(np.full(N_STOPS, 2.0), damping_ratio, noise))
    assert ring.frequency_hz == pytest.approx(2.0, rel=0.05)
    assert ring.damping_ratio == pytest.approx(damping_ratio, abs=0.05)


@pytest.mark.parametrize(("lowest", "highest"), [(1.6, 2.0), (0.9, 2.3)])
def test_poses_of_different_frequency_do_not_look_like_damping(lowest: float, highest: float) -> None:
    frequencies = np.random.default_rng(1).uniform(lowest, highest, N_STOPS)
    ring = found(stops(frequencies, 0.06, noise=5e-4))
    assert ring.frequency_hz == pytest.approx(np.median(frequencies), rel=0.05)
    assert ring.damping_ratio == pytest.approx(0.06, abs=0.02)
    assert ring.frequency_deviation_hz > 0.1 * (highest - lowest)  # over poses there is no one frequency


def test_what_does_not_ring_or_hardly_stops_has_no_frequency() -> None:
    assert found(stops(np.full(4, 2.0), 0.05, noise=0.0)) is None
    falling = stops(np.full(N_STOPS, 2.0), 0.05, noise=0.0)
    time_s = DT_S * (np.arange(falling.velocity.shape[1]) % (N_MOVING + N_RESTING) - N_MOVING)
    decay = np.where(time_s > 0, 0.3 * np.exp(-time_s) + 0.1 * np.exp(-3.0 * time_s), 0.4)
    assert found(falling._replace(velocity=decay[None, :, None])) is None


def test_a_rest_of_which_only_the_end_may_be_looked_at_is_no_stop() -> None:
    ringing = stops(np.full(N_STOPS, 1.2), 0.02, noise=0.0)
    row = np.arange(ringing.is_row.shape[1]) % (N_MOVING + N_RESTING)
    assert ring_down(ringing, (row >= N_MOVING)[None], joint=0, dt_s=DT_S) is not None
    assert ring_down(ringing, (row >= N_MOVING + 5)[None], joint=0, dt_s=DT_S) is None
