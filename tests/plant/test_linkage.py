import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.plant.machines.bobcat_e10 import BORE_M, EXTENDS_POSITIVE, GEOMETRY, LOWER_RAD, UPPER_RAD
from pipeline.plant.physics.linkage import FourBar, Triangle, tabulate


def test_triangle_length_is_the_distance_of_its_pins():
    triangle = Triangle(fixed_m=0.3, moving_m=0.7, angle_at_zero_rad=0.8, sign=1.0)
    q = np.linspace(-0.5, 1.0, 7)
    fixed = np.array([0.3, 0.0])
    moving = 0.7 * np.stack([np.cos(0.8 + q), np.sin(0.8 + q)], axis=-1)
    np.testing.assert_allclose(triangle.length(q), np.linalg.norm(moving - fixed, axis=-1), rtol=1e-12)


def test_four_bar_closes():
    """The pins that the closed form implies are as far apart as the bars are long."""
    bars = GEOMETRY[3]
    assert isinstance(bars, FourBar)
    q = np.linspace(LOWER_RAD[3], UPPER_RAD[3], 50)
    length = bars.length(q)
    cosine = (bars.cylinder_base_m**2 + bars.rocker_m**2 - length**2) / (
        2 * bars.cylinder_base_m * bars.rocker_m
    )
    rocker_angle = bars.cylinder_base_angle_rad - np.arccos(cosine)
    rocker = np.stack(
        [-bars.rocker_pivot_m + bars.rocker_m * np.cos(rocker_angle), bars.rocker_m * np.sin(rocker_angle)],
        axis=-1,
    )
    crank_angle = q + bars.crank_angle_at_zero_rad
    crank = bars.crank_m * np.stack([np.cos(crank_angle), np.sin(crank_angle)], axis=-1)
    np.testing.assert_allclose(np.linalg.norm(crank - rocker, axis=-1), bars.coupler_m, rtol=1e-9)


@pytest.mark.parametrize("joint", range(4))
def test_tables_agree_with_the_closed_form(joint, nominal):
    geometry = GEOMETRY[joint]
    q = np.linspace(LOWER_RAD[joint], UPPER_RAD[joint], nominal.linkage.travel_m.shape[1])
    travel = np.abs(geometry.length(q) - geometry.length(q[:1]))
    np.testing.assert_allclose(nominal.linkage.travel_m[joint], travel, atol=1e-7)
    extends = geometry.length(q)[-1] > geometry.length(q)[0]
    assert extends == EXTENDS_POSITIVE[joint]


@pytest.mark.parametrize("joint", range(4))
def test_cylinders_could_be_built(joint):
    """Closed length holds the stroke, piston and eyes; bore is slender against the stroke."""
    q = np.linspace(LOWER_RAD[joint], UPPER_RAD[joint], 200)
    length = GEOMETRY[joint].length(q)
    assert length.min() > length.max() - length.min() + 0.12
    assert length.max() - length.min() > 3.0 * BORE_M[joint]


def test_dead_centre_is_refused():
    with pytest.raises(InputError, match="dead centre"):
        tabulate(Triangle(0.3, 0.2, 0.5, 1.0), -1.0, 1.0, 101)
