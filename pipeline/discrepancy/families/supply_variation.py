"""`supply_variation`: an unobserved change of speed that all joints have in common.

There is nothing to regress on but the joints themselves. From the residuals of all other joints the common change is
estimated as a moving average in time, and it is tried whether it predicts this joint's residual.

Equation: v_j = u_j e^{z(t)}, z an Ornstein-Uhlenbeck process; source: Gelb (1974), Applied Optimal Estimation,
chapter 3.
"""

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.ndimage import gaussian_filter1d

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


def without_common_change(
    simulation: Simulation, active: Hypothesis, rows: ScoredRows, widths_s: Mapping[int, float]
) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Residuals (N,) of each joint, and what is left of them without what the other joints predict."""
    common = _Common(simulation, active, rows)
    return {
        joint: (common.reference[:, joint], common.evidence(joint, {"width": width_s}).after)
        for joint, width_s in widths_s.items()
    }


def why_it_is_no_supply(correlation_time_s: float, n_joints: int) -> str | None:
    """A clause where a common change of speed is none; None: it is one.

    A supply changes the speed of every joint, and for longer than the model is off alike where joints start and stop
    together.
    """
    if n_joints < 2:
        return "all joints have a supply in common, and one alone shows this"
    if correlation_time_s >= SHORTEST_S:
        return None
    return f"a correlation time of {correlation_time_s:.2g} s is that of joints which start and stop together"


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
