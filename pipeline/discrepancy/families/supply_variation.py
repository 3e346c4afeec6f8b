"""`supply_variation`: an unobserved change of speed that all joints have in common.

There is nothing to regress on but the joints themselves. From the residuals of all other joints the common change is
estimated as a moving average in time, and it is tried whether it predicts this joint's residual.

Equation: v_j = u_j e^{z(t)}, z an Ornstein-Uhlenbeck process; source: Gelb (1974), Applied Optimal Estimation,
chapter 3.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.special import ndtr, ndtri

from pipeline.discrepancy.acceptance.placebos import shifted_p
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation
from pipeline.discrepancy.families.change_of_speed import ChangeOfSpeed
from pipeline.discrepancy.selection.candidate import Candidate, Nominal

FAMILY = "supply_variation"
WIDTHS_S = (0.7, 1.5, 3.0, 6.0, 12.0)  # the first is no longer than motions are
# Of what the first explains, by the second: of what is off alike at starts and stops 0.5 to 0.6, of a supply of a
# correlation time of 1.5 s 0.8.
KEPT_SHARE = 0.7
STEP_S, LAGS = 0.5, np.arange(2, 41)  # of the covariance: 1 to 20 s
MOST_ALIKE = 0.999  # a correlation whose transform is finite
SHORTEST_S = STEP_S * float(LAGS[0])  # correlation time that the covariance can tell


class _Common(ChangeOfSpeed):
    """The common change of speed as the other joints show it."""

    family = FAMILY
    widths_s = WIDTHS_S

    def options(self, joint: int) -> list[Candidate]:
        """All but the shortest time, unless what it explains is lost over the next one, as of starts and stops."""
        shortest, *longer = super().options(joint)
        is_lost = longer[0].gain < KEPT_SHARE * shortest.gain
        return [shortest, *longer] if is_lost else longer

    def __init__(self, simulation: Simulation, active: Hypothesis, rows: ScoredRows) -> None:
        super().__init__(simulation, active, rows, rows.is_used[..., None])

    def of(self, joint: int, width: float) -> np.ndarray:
        """By all joints but one: a moving average of their residuals per velocity."""
        product, square = (self._by_others(of, joint, width) for of in (self.product, self.square))
        z = self.ratio(product, square, square * width / self.dt_s)
        # What stays the same all the time is a gain of every joint, not a variation.
        motion = self.square[..., joint]
        return z - np.sum(z * motion) / max(np.sum(motion), 1e-12)

    def _by_others(self, of: np.ndarray, joint: int, width: float) -> np.ndarray:
        """(B, T) moving average of a quantity (B, T, n_joint) of all joints but one."""
        others = [other for other in range(of.shape[-1]) if other != joint]
        return gaussian_filter1d(of[..., others].sum(axis=-1), width / self.dt_s, axis=1, mode="constant")


def supply_candidates(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, nominal: Nominal = MappingProxyType({})
) -> list[Candidate]:
    """One candidate per joint, at the best width; arguments as of `ChangeOfSpeed`, and of its `candidates`."""
    return _Common(simulation, active, rows).candidates(nominal)


def supply_p(
    simulation: Simulation,
    active: Hypothesis,
    parts: Sequence[ScoredRows],
    widths_s: Mapping[int, float],
    seed: int,
) -> float:
    """How probable it is that changes which joints do not have in common are as much alike.

    Placebos are the others' common change shifted in time. What is compared is the mean over joints of its correlation
    with the joint's residual, by Fisher's transformation, which is normal beyond what can be counted even where a slow
    supply leaves few independent values.
    Source: Fisher (1921), On the probable error of a coefficient of correlation, Metron 1.

    Args:
        simulation: On the logs.
        active: Effects beside it.
        parts: Rows, all of which count alike: the slower the supply, the more of them it takes.
        widths_s: Width of the moving average for each joint that has the effect.
        seed: Of the shifts.
    """
    common = [_Common(simulation, active, rows) for rows in parts]
    z = [{joint: of.of(joint, width_s) for joint, width_s in widths_s.items()} for of in common]
    n_rows = max(int(rows.is_used.sum()) for rows in parts)

    def likeness(shift: int) -> float:
        correlations = []
        for joint in widths_s:
            changes = [
                of.regressor(joint, _rolled(z_of[joint], of.rows.is_used, shift / n_rows))
                for of, z_of in zip(common, z, strict=True)
            ]
            change = np.concatenate(changes)
            residual = np.concatenate([of.reference[:, joint] for of in common])
            square = float(change @ change) * float(residual @ residual)
            correlations.append(float(change @ residual) / np.sqrt(max(square, 1e-24)))
        return float(np.arctanh(np.clip(np.mean(correlations), -MOST_ALIKE, MOST_ALIKE)))

    # Not shifted, what one joint says of another is what that says of it; shifted, it is another value. The mean over
    # joints scatters by up to the root of two more than the placebos do.
    return float(ndtr(ndtri(shifted_p(likeness, n_rows, seed)) / np.sqrt(2.0)))


def _rolled(z: np.ndarray, is_used: np.ndarray, share: float) -> np.ndarray:
    """(B, T) values shifted cyclically by a share of the rows in use, from row to row of these."""
    rolled = np.zeros_like(z)
    rolled[is_used] = np.roll(z[is_used], round(share * int(is_used.sum())))
    return rolled


def without_common_change(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, widths_s: Mapping[int, float]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Residuals (N,) of each joint, and what is left of them without what the other joints predict; as `supply_p`."""
    common = _Common(simulation, active, rows)
    return {
        joint: (common.reference[:, joint], common.evidence(joint, {"width": width_s}).after)
        for joint, width_s in widths_s.items()
    }


def supply_parameters(
    measured: tuple[Simulation, ScoredRows], nominal: tuple[Simulation, ScoredRows], active: Hypothesis
) -> dict[str, float]:
    """Standard deviation and correlation time of z, from products of residuals at a distance in time.

    Products of the residual at t and at t + s, each divided by its velocity, have the mean e^{-s/T} std² where the
    noise of both is independent: for s of one second and more. What nominal logs vary by is not part of it.

    Args:
        measured: The logs in question, and their rows in use.
        nominal: The same of nominal logs, by members that did not see them.
        active: Effects beside it on the measured logs, whose part in the residual is not the supply's.
    """
    (simulation, rows), (usual, usual_rows) = measured, nominal
    variance, time_s = _process(
        _covariance(_Common(simulation, active, rows)) - _covariance(_Common(usual, NOMINAL, usual_rows))
    )
    return {"std_log_speed": float(np.sqrt(variance)), "correlation_time": time_s}


def _process(covariance: np.ndarray) -> tuple[float, float]:
    """Variance and correlation time, s, of the Ornstein-Uhlenbeck process nearest to the covariance at `LAGS`."""
    best = (np.inf, 0.0, 1.0)
    for time_s in np.geomspace(0.5, 60.0, 60):
        shape = np.exp(-LAGS * STEP_S / time_s)
        variance = max(float(shape @ covariance / (shape @ shape)), 0.0)
        loss = float(np.sum((covariance - variance * shape) ** 2))
        if loss < best[0]:
            best = (loss, variance, float(time_s))
    return best[1:]


def _covariance(common: _Common) -> np.ndarray:
    """Of the common change of speed, at `LAGS`."""
    numerator, denominator = common.product.sum(axis=-1), common.square.sum(axis=-1)
    step = round(STEP_S / common.dt_s)
    n = numerator.shape[1] // step * step
    numerator, denominator = (
        x[:, :n].reshape(len(x), -1, step).sum(axis=-1) for x in (numerator, denominator)
    )
    return np.array(
        [
            np.sum(numerator[:, lag:] * numerator[:, :-lag])
            / max(np.sum(denominator[:, lag:] * denominator[:, :-lag]), 1e-9)
            for lag in LAGS
        ]
    )
