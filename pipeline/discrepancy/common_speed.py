"""`supply_variation`: an unobserved change of speed that all joints have in common.

There is nothing to regress on but the joints themselves. From the residuals of all other joints the common change is
estimated as a moving average in time, and it is tried whether it predicts this joint's residual.

Equation: v_j = u_j e^{z(t)}, z an Ornstein-Uhlenbeck process; source: Gelb (1974), Applied Optimal Estimation,
chapter 3.
"""

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pipeline.discrepancy.regression import evidence
from pipeline.discrepancy.screen import Candidate, Rows, averaged, scored
from pipeline.discrepancy.simulation import Hypothesis, Simulation

FAMILY = "supply_variation"
WIDTHS_S = (0.7, 1.5, 3.0, 6.0, 12.0)
PRIOR_STD = 0.1  # of z: keeps the estimate at zero where nothing moves


def common_speed_candidates(simulation: Simulation, active: Hypothesis, rows: Rows) -> list[Candidate]:
    """One candidate per joint, at the best width of the moving average."""
    velocity = simulation.velocities([active])[0]
    sequences = simulation.sequences
    usable = rows.is_used[..., None]
    residual = np.where(usable, sequences.velocity - velocity, 0.0)
    moving = np.where(usable, velocity, 0.0)
    reference = rows.weight * rows.averaged(residual)
    n_joint = velocity.shape[-1]
    best: dict[int, Candidate] = {}
    for width_s in WIDTHS_S:
        width = width_s / simulation.setting.dt_s
        product = gaussian_filter1d(residual * moving / rows.floor, width, axis=1, mode="constant")
        square = gaussian_filter1d(moving**2 / rows.floor, width, axis=1, mode="constant")
        for joint in range(n_joint):
            others = [other for other in range(n_joint) if other != joint]
            # The floor's correlation leaves about one independent value per second.
            information = square[..., others].sum(axis=-1) * width * simulation.setting.dt_s
            z = product[..., others].sum(axis=-1) / np.maximum(square[..., others].sum(axis=-1), 1e-9)
            z = z * information / (information + 1.0 / PRIOR_STD**2)
            # What stays the same all the time is a gain of every joint, not a variation.
            z = z - np.sum(z * moving[..., joint] ** 2) / max(np.sum(moving[..., joint] ** 2), 1e-12)
            regressor = rows.weight[:, joint] * averaged(z * moving[..., joint], rows.is_used)
            found = evidence(
                reference[:, joint],
                reference[:, joint],
                regressor[:, None],
                rows.folds,
                np.array([0.0]),
                np.array([2.0]),
            )
            candidate = scored(
                found, reference[:, joint], rows.floor[joint], FAMILY, joint, None, {"width": width_s}, ()
            )
            if joint not in best or candidate.gain > best[joint].gain:
                best[joint] = candidate
    return list(best.values())


def common_speed_parameters(simulation: Simulation, active: Hypothesis, rows: Rows) -> dict[str, float]:
    """Standard deviation and correlation time of z, from products of residuals at a distance in time.

    Products of the residual at t and at t + s, each divided by its velocity, have the mean e^{-s/T} std² where the
    noise of both is independent: for s of one second and more.
    """
    velocity = simulation.velocities([active])[0]
    residual = np.where(rows.is_used[..., None], simulation.sequences.velocity - velocity, 0.0)
    moving = np.where(rows.is_used[..., None], velocity, 0.0)
    numerator = (residual * moving / rows.floor).sum(axis=-1)
    denominator = (moving**2 / rows.floor).sum(axis=-1)
    step = round(0.5 / simulation.setting.dt_s)
    n = numerator.shape[1] // step * step
    numerator, denominator = (
        x[:, :n].reshape(len(x), -1, step).sum(axis=-1) for x in (numerator, denominator)
    )
    lags = np.arange(2, 41)
    covariance = np.array(
        [
            np.sum(numerator[:, lag:] * numerator[:, :-lag])
            / max(np.sum(denominator[:, lag:] * denominator[:, :-lag]), 1e-9)
            for lag in lags
        ]
    )
    best, value = (np.inf, 0.0, 1.0), covariance
    for time_s in np.geomspace(0.5, 60.0, 60):
        shape = np.exp(-lags * 0.5 / time_s)
        variance = max(float(shape @ value / (shape @ shape)), 0.0)
        loss = float(np.sum((value - variance * shape) ** 2))
        if loss < best[0]:
            best = (loss, variance, float(time_s))
    return {"std_log_speed": float(np.sqrt(best[1])), "correlation_time": best[2]}
