"""Slow variations of a joint's speed, as columns: v = u (1 + Σ_k c_k φ_k(t)), φ_k cosines over a session.

Coefficients with the spectrum of an Ornstein-Uhlenbeck process make the sum such a process. Source: Rasmussen and
Williams (2006), Gaussian Processes for Machine Learning, appendix B.
"""

import numpy as np

N_COSINE = 60  # over a session of six minutes, periods of 12 s and more
USUAL_DEVIATION, USUAL_TIME_S = (
    0.1,
    5.0,
)  # of what varies from session to session, before nominal logs are seen
HIGHEST = 4000  # cosines that make up the whole variance
TIMES_S = (2.0, 6.0, 20.0)
DEVIATIONS = (0.04, 0.1, 0.25)
NANOSECONDS = 1e9


def cosines(stamp_ns: np.ndarray, part: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, N_COSINE) over each part's time, and the parts' mean length, s."""
    result, lengths_s = np.zeros((len(part), N_COSINE), np.float32), []
    for number in np.unique(part):
        of = part == number
        time_s = (stamp_ns[of] - stamp_ns[of].min()) / NANOSECONDS
        length_s = max(float(time_s.max()), 1.0)
        lengths_s.append(length_s)
        result[of] = np.sqrt(2.0) * np.cos(np.pi * np.outer(time_s / length_s, np.arange(1, N_COSINE + 1)))
    return result, float(np.mean(lengths_s))


def deviations(length_s: float, time_s: float, deviation: float) -> np.ndarray:
    """(N_COSINE,) standard deviations of the coefficients of a process with a correlation time and a deviation."""
    spectrum = 1.0 / (1.0 + (np.pi * np.arange(1, HIGHEST + 1) / length_s * time_s) ** 2)
    return np.asarray(deviation * np.sqrt(spectrum[:N_COSINE] / spectrum.sum()))
