import numpy as np

from pipeline.plant.simulator import Plant

from .conftest import MIDDLE, random_commands


def test_rates_jitter_latency_and_quantum_are_those_of_the_practice_logs(nominal):
    """Measured there: 50 Hz, stamp differences 16-24 ms, 0.8-2.8 ms to the log, a 13-bit quantum."""
    sample = Plant(nominal, 0, MIDDLE).run(random_commands(0, 120, 10))
    states = sample.joint_states
    step = np.diff(states.stamp_s)
    assert abs(step.mean() - 0.020) < 1e-5
    assert 0.016 <= step.min() < step.max() <= 0.024
    assert abs(step.std() - 0.00163) < 1e-4
    latency = states.log_s - states.stamp_s
    assert 0.0008 <= latency.min() < latency.max() <= 0.0028
    counts = states.position_rad / (2 * np.pi / 8192)
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    assert np.all(np.diff(states.log_s) > 0)
    assert abs(np.diff(sample.command_log_s).mean() - 0.050) < 1e-4


def test_readings_are_the_true_angles_with_the_stated_noise(nominal):
    sample = Plant(nominal, 0, MIDDLE).run(random_commands(0, 60, 20))
    for joint in range(4):
        true = np.interp(sample.joint_states.stamp_s, sample.end_s, sample.angle_rad[:, joint])
        still = np.abs(np.gradient(true)) < 1e-5
        error = (sample.joint_states.position_rad[:, joint] - true)[
            still & (sample.joint_states.stamp_s > 0.05)
        ]
        expected = np.hypot(nominal.sensor.noise_std_rad, nominal.sensor.quantum_rad / np.sqrt(12))
        assert abs(np.mean(error)) < 1e-4
        assert 0.7 * expected < np.std(error) < 1.5 * expected


def test_dropped_readings_leave_gaps(nominal):
    lossy = nominal.change("sensor", drop_probability=0.3)
    kept = Plant(lossy, 0, MIDDLE).run(np.zeros((400, 4))).joint_states.stamp_s
    assert 0.6 < kept.size / 1000 < 0.8
