"""What the model is off by on nominal logs that it did not see, at rest and under way, and for how long alike."""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour
from pipeline.discrepancy.diagnosis.scored_rows import ROWS_AVERAGED
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.dynamics.model.shown_motion import STANDING_SHARE

LONGEST_CORRELATION_S = 2.0  # that is looked for: some rise times of a joint


class Noise(NamedTuple):
    """What the model is off by on nominal logs that it did not see.

    Attributes:
        moving: (n_joint,) standard deviation of averaged velocities while the joint moves, rad/s (m/s).
        standing: (n_joint,) the same at rest.
        correlated: (n_joint,) rows that count as one, since errors follow one another.
        unrepeated: (n_joint,) standard deviation of speeds from log to log, as a share.
    """

    moving: np.ndarray
    standing: np.ndarray
    correlated: np.ndarray
    unrepeated: np.ndarray


def noise_of(nominal: NominalBehaviour, dt_s: float) -> Noise:
    """Of the nominal logs."""
    sequences, rows = nominal.simulation.sequences, nominal.rows
    expected = nominal.simulation.velocities([NOMINAL])[0]
    v = rows.averaged(expected)
    residual = rows.weight * (rows.averaged(sequences.velocity) - v)
    number = np.broadcast_to(np.arange(len(sequences.q))[:, None], sequences.is_row.shape)
    log = rows.averaged(number.astype(float))
    n_joint = v.shape[1]
    moving, standing, correlated, unrepeated = (np.zeros(n_joint) for _ in range(4))
    longest = max(round(LONGEST_CORRELATION_S / dt_s) // ROWS_AVERAGED, 1)
    for joint in range(n_joint):
        counts = rows.weight[:, joint] > 0.0
        moves = np.abs(v[:, joint]) > STANDING_SHARE * nominal.setting.speed_scale[joint]
        r = residual[:, joint]
        at_rest = np.sqrt(nominal.floor[joint] * nominal.at_rest[joint])
        moving[joint] = max(np.sqrt(np.mean(r[counts & moves] ** 2)), at_rest)
        standing[joint] = at_rest
        correlated[joint] = _correlated_rows(r[counts & moves], longest)
        slopes = [
            float(np.sum(r[of] * v[of, joint]) / np.sum(v[of, joint] ** 2))
            for one in np.unique(log)
            if (of := counts & moves & (log == one)).sum() > longest
        ]
        unrepeated[joint] = np.std(slopes, ddof=1) if len(slopes) > 1 else 0.0
    return Noise(moving, standing, correlated, unrepeated)


def _correlated_rows(r: np.ndarray, longest: int) -> float:
    """Integrated autocorrelation up to the first lag that is not positive (Geyer 1992, Statistical Science 7)."""
    r = r - r.mean()
    squares = float(np.mean(r**2))
    total = 1.0
    for lag in range(1, longest + 1):
        rho = float(np.mean(r[lag:] * r[:-lag])) / squares
        if rho <= 0.0:
            break
        total += 2.0 * rho
    return total
