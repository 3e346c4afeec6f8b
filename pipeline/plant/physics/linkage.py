"""Cylinder linkages: joint angle to cylinder length and moment arm.

Swing, boom and arm cylinders close a triangle with two pivots; the bucket cylinder turns a rocker, which
turns the bucket through a coupler (four-bar linkage), as on every backhoe. The closed forms are evaluated
once on a grid; the simulation interpolates, which keeps travel the exact integral of the moment arm and so
loses no energy between the two.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.integrate import cumulative_simpson

from pipeline.errors import InputError


class CylinderGeometry(Protocol):
    """Anything that gives a cylinder length for a joint angle."""

    def length(self, q: np.ndarray) -> np.ndarray:
        """Cylinder length, pin to pin, m, for joint angles `q`, rad."""
        ...


@dataclass(frozen=True)
class Triangle:
    """Cylinder between a pin on the fixed side and a pin on the moving side of one joint.

    Law of cosines: l² = a² + b² − 2ab·cos(γ), γ = γ₀ + sign·q.
    """

    fixed_m: float  # joint to pin on the fixed side, a
    moving_m: float  # joint to pin on the moving side, b
    angle_at_zero_rad: float  # γ₀
    sign: float  # +1: the joint's positive motion extends the cylinder

    def length(self, q: np.ndarray) -> np.ndarray:
        """See `CylinderGeometry.length`."""
        angle = self.angle_at_zero_rad + self.sign * q
        return np.sqrt(
            self.fixed_m**2 + self.moving_m**2 - 2.0 * self.fixed_m * self.moving_m * np.cos(angle)
        )


@dataclass(frozen=True)
class FourBar:
    """Bucket linkage: cylinder, rocker on the arm, coupler, bucket crank.

    Frame: bucket pivot at the origin, arm pivot on the negative x axis, rocker pivot at (−d, 0). The crank
    pin lies at angle φ = q + φ₀; rocker angle by the closure of the four-bar (two circles), cylinder by the
    law of cosines about the rocker pivot.
    """

    rocker_pivot_m: float  # d
    rocker_m: float
    coupler_m: float
    crank_m: float
    crank_angle_at_zero_rad: float  # φ₀
    cylinder_base_m: float  # rocker pivot to the cylinder's pin on the arm
    cylinder_base_angle_rad: float

    def length(self, q: np.ndarray) -> np.ndarray:
        """See `CylinderGeometry.length`.

        Raises:
            InputError: the four bars cannot close at some angle.
        """
        angle = q + self.crank_angle_at_zero_rad
        x = self.crank_m * np.cos(angle) + self.rocker_pivot_m
        y = self.crank_m * np.sin(angle)
        diagonal = np.hypot(x, y)
        cosine = (self.rocker_m**2 + diagonal**2 - self.coupler_m**2) / (2.0 * self.rocker_m * diagonal)
        if np.any(np.abs(cosine) > 1.0):
            raise InputError(
                "bucket linkage: the four bars do not close over the joint's range; lengthen the coupler"
            )
        rocker_angle = np.unwrap(np.arctan2(y, x)) + np.arccos(cosine)
        return np.sqrt(
            self.cylinder_base_m**2
            + self.rocker_m**2
            - 2.0 * self.cylinder_base_m * self.rocker_m * np.cos(self.cylinder_base_angle_rad - rocker_angle)
        )


def tabulate(
    geometry: CylinderGeometry, lower_rad: float, upper_rad: float, n_grid: int
) -> tuple[np.ndarray, np.ndarray]:
    """Moment arm and travel on an even grid from `lower_rad` to `upper_rad`.

    Returns:
        Moment arm |dl/dq| (n_grid,), m, and travel |l(q) − l(lower)| (n_grid,), m.

    Raises:
        InputError: the cylinder length is not monotonic over the range (dead centre).
    """
    q = np.linspace(lower_rad, upper_rad, n_grid)
    step = 1e-5
    slope = (geometry.length(q + step) - geometry.length(q - step)) / (2.0 * step)
    if np.any(slope[0] * slope <= 0.0):
        raise InputError(
            f"{geometry}: the cylinder passes a dead centre between {lower_rad} and {upper_rad} rad"
        )
    arm = np.abs(slope)
    return arm, cumulative_simpson(arm, x=q, initial=0.0)
