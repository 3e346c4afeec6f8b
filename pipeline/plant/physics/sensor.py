"""Encoders and the way of their readings into the log: noise, quantisation, stamps, publication.

Random numbers are drawn per reading from streams of their own, so that the readings do not depend on how
many control periods are simulated per call.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.plant.compiled import compiled
from pipeline.plant.drawn import Rows
from pipeline.plant.parameters import Sensor


@dataclass(frozen=True)
class JointStates:
    """Joint states as published. Times are seconds since the plant's start."""

    stamp_s: np.ndarray  # (N,) header stamps
    log_s: np.ndarray  # (N,) when they reach the log
    position_rad: np.ndarray  # (N, n_joint)


@compiled
def read_encoders(
    sampled_s: np.ndarray,
    times_s: np.ndarray,
    angle_rad: np.ndarray,
    noise: np.ndarray,
    scale: np.ndarray,
    offset_rad: np.ndarray,
    noise_std_rad: float,
    quantum_rad: float,
) -> np.ndarray:
    """Readings (N, n), rad, of angles (K, n) at times (K,), interpolated, with standard normal noise (N, n)."""
    readings = np.empty_like(noise)
    for i in range(len(sampled_s)):
        after = np.searchsorted(times_s, sampled_s[i], side="right")
        after = min(max(after, 1), len(times_s) - 1)
        step_s, since_s = times_s[after] - times_s[after - 1], max(sampled_s[i] - times_s[after - 1], 0.0)
        for j in range(noise.shape[1]):
            before = angle_rad[after - 1, j]
            exact = (angle_rad[after, j] - before) / step_s * since_s + before
            exact = exact * scale[j] + offset_rad[j] + noise_std_rad * noise[i, j]
            readings[i, j] = np.round(exact / quantum_rad) * quantum_rad
    return readings


@compiled
def follow(trace_rad: np.ndarray, shaft_rad: np.ndarray, flex_rad: np.ndarray) -> np.ndarray:
    """Angles (K, n) of shafts that follow a trace (K, n) within a band; `shaft_rad` (n,) is where they were, and are.

    Friction holds the shaft until its mount has given way by half the band (the play operator of Krasnosel'skii and
    Pokrovskii, Systems with Hysteresis, 1989). Without a band the shaft has the trace's angle.
    """
    followed = np.empty_like(trace_rad)
    for k in range(trace_rad.shape[0]):
        for j in range(trace_rad.shape[1]):
            low, high = trace_rad[k, j] - 0.5 * flex_rad[j], trace_rad[k, j] + 0.5 * flex_rad[j]
            shaft_rad[j] = min(max(shaft_rad[j], low), high)
            followed[k, j] = shaft_rad[j]
    return followed


class EncoderChannel:
    """Samples a trace of true angles at jittered times and publishes the readings."""

    def __init__(self, n_joint: int, seed: np.random.SeedSequence) -> None:
        times, noise = seed.spawn(2)
        self._times = Rows(np.random.default_rng(times).random, 3)
        self._noise = Rows(np.random.default_rng(noise).standard_normal, n_joint)
        self._n_published = 0
        self._shaft_rad: np.ndarray | None = None
        self._tail_s = np.empty(0)
        self._tail_rad = np.empty((0, n_joint))

    def publish(self, sensor: Sensor, trace_s: np.ndarray, trace_rad: np.ndarray) -> JointStates:
        """All joint states that are due by the end of the trace.

        Args:
            sensor: encoder quantities.
            trace_s: times of the trace, (K,), s, continuing the previous call's.
            trace_rad: true angles, (K, n_joint), rad.
        """
        if self._shaft_rad is None:
            self._shaft_rad = trace_rad[0].copy()
        shaft_rad = follow(trace_rad, self._shaft_rad, sensor.mount_flex_rad)
        times = np.concatenate([self._tail_s, trace_s])
        angles = np.concatenate([self._tail_rad, shaft_rad])
        latest = sensor.period_s * self._n_published + 2.0 * sensor.stamp_jitter_s
        n_due = max(int(np.floor((times[-1] - latest) / sensor.period_s)) + 1, 0)
        # one row per reading: jitter, publication delay, whether it is lost
        uniform = self._times.take(n_due)
        sampled = (
            sensor.period_s * (self._n_published + np.arange(n_due))
            + 2.0 * sensor.stamp_jitter_s * uniform[:, 0]
        )
        stamp = sampled + sensor.stamp_lateness_s
        least, most = sensor.publication_delay_s
        log = stamp + least + (most - least) * uniform[:, 1]
        kept = uniform[:, 2] >= sensor.drop_probability
        self._n_published += n_due
        first_needed = sensor.period_s * self._n_published
        keep_from = max(int(np.searchsorted(times, first_needed, side="right")) - 1, 0)
        self._tail_s, self._tail_rad = times[keep_from:], angles[keep_from:]
        readings = read_encoders(
            sampled,
            times,
            angles,
            self._noise.take(n_due),
            sensor.scale,
            sensor.offset_rad,
            sensor.noise_std_rad,
            sensor.quantum_rad,
        )
        return JointStates(stamp[kept], log[kept], readings[kept])
