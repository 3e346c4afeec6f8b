"""Coverage of W+ against a count pose by pose, and against an arm of which all that it reaches is known."""

import copy
import itertools
import math

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.viewing.coverage import Coverage, ReachableCells
from pipeline.errors import InputError
from pipeline.machine.chain import FIXED, ChainJoint
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import JointKind, JointSpecification, MachineSpecification
from pipeline.machine.workspace import contains
from tests.deployment.machines import arm, bobcat

PROFILE = load_section("coverage", CoverageConfig)
FEW = CoverageConfig(cell_m=0.24, pitch_bin_rad=0.16, pitch_max_rad=1.047, samples_per_cell=4)
# bobcat_e10's W+: radius 0.9 to 2.6 m, yaw within 0.85 rad, height 0.155 to 2.5 m
RADII = np.linspace(0.9, 2.6, 9)
LAYERS, BINS = np.linspace(0.155, 2.5, 11), np.linspace(-1.047, 1.047, 15)


def interval(edges: np.ndarray, value: float) -> int:
    """By trying one after the other."""
    return next(i for i in range(len(edges) - 1) if value < edges[i + 1] or i == len(edges) - 2)


def columns(ring: int) -> np.ndarray:
    return np.linspace(-0.85, 0.85, math.ceil(1.7 * RADII[ring + 1] / 0.24) + 1)


def cell_by_hand(x: float, y: float, z: float, yaw: float, pitch: float) -> tuple[int, int, int, int]:
    ring = interval(RADII, math.hypot(x, y))
    return ring, interval(columns(ring), yaw), interval(LAYERS, z), interval(BINS, pitch)


ALL = sum((len(columns(ring)) - 1) for ring in range(8)) * 10 * 14


@pytest.fixture(scope="module")
def bobcats() -> ReachableCells:
    return ReachableCells(bobcat(), arm(), FEW)


def test_one_pose_at_a_time_is_a_count_of_distinct_cells(bobcats: ReachableCells) -> None:
    machine, kinematics = bobcat(), arm()
    assert machine.workspace is not None
    q = np.random.default_rng(1).uniform(machine.lower, machine.upper, (1000, 4))
    position, yaw, pitch = kinematics.forward(q).position, kinematics.yaw(q), kinematics.pitch(q)
    inside = np.asarray(contains(machine.workspace, position, yaw)) & (np.abs(pitch) <= 1.047)
    coverage, seen = Coverage(bobcats), set()
    for i in range(len(q)):
        coverage.add(q[i : i + 1])
        if inside[i]:
            seen.add(cell_by_hand(*position[i], yaw[i], pitch[i]))
        assert coverage.n_visited == len(seen)
    assert bobcats.n == ALL and 100 < len(seen) < inside.sum()
    assert coverage.share == len(seen) / coverage.n_reachable
    at_once = Coverage(bobcats)
    at_once.add(q)
    assert at_once.share == coverage.share


def test_bounds_of_the_workspace_are_inside(bobcats: ReachableCells) -> None:
    poses = np.array(list(itertools.product((0.9, 2.6), (-0.85, 0.85), (0.155, 2.5), (-1.047, 1.047))))
    radius, yaw, z, pitch = poses.T
    position = np.stack([radius * np.cos(yaw), radius * np.sin(yaw), z], axis=1)
    hypot = np.hypot(position[:, 0], position[:, 1])
    held = np.clip(hypot, 0.9, 2.6) / hypot  # rounding of the cosine
    cells, off = bobcats._cells.locate(position * np.stack([held, held, 0 * z + 1], axis=1), yaw, pitch)
    assert len(set(cells.tolist())) == 16 and cells.min() == 0 and cells.max() == bobcats.n - 1
    np.testing.assert_allclose(off, 1.0)
    behind, _ = bobcats._cells.locate(-position, yaw, pitch)
    assert (behind == -1).all()


LIMITS = {"swing": (-0.2, 0.3), "out": (1.2, 2.0), "up": (0.3, 1.0), "tilt": (-0.4, 2.0)}


@pytest.fixture
def gantry() -> tuple[MachineSpecification, Arm]:
    """Joints that are the cylinder coordinates of the tip, and its pitch."""
    machine = copy.deepcopy(bobcat())
    kinds = (JointKind.revolute, JointKind.prismatic, JointKind.prismatic, JointKind.revolute)
    machine.joints = [
        JointSpecification(name, lower, upper, kind)
        for (name, (lower, upper)), kind in zip(LIMITS.items(), kinds, strict=True)
    ]
    assert machine.arm is not None
    machine.arm.yaw_joint, machine.arm.pitch_joints, machine.arm.pitch_offset_rad = "swing", ["tilt"], 0.0
    axes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
    chain = [
        ChainJoint(name, str(kind), "", "", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), axis, LIMITS[name])
        for name, kind, axis in zip(LIMITS, kinds, axes, strict=True)
    ]
    chain.append(ChainJoint("tip", FIXED, "", "", (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0, 0)))
    return machine, Arm(machine, chain)


def overlapping(edges: np.ndarray, bounds: tuple[float, float]) -> int:
    return sum(edges[i] < bounds[1] and edges[i + 1] > bounds[0] for i in range(len(edges) - 1))


def test_what_a_gantry_reaches_is_what_its_limits_overlap(gantry: tuple[MachineSpecification, Arm]) -> None:
    reachable = ReachableCells(*gantry, PROFILE)
    by_ring = [
        overlapping(columns(ring), LIMITS["swing"]) * overlapping(RADII[ring : ring + 2], LIMITS["out"])
        for ring in range(8)
    ]
    expected = sum(by_ring) * overlapping(LAYERS, LIMITS["up"]) * overlapping(BINS, LIMITS["tilt"])
    assert len(reachable.numbers) == expected
    np.testing.assert_array_equal(reachable.cells_of(reachable.configurations), reachable.numbers)
    coverage = Coverage(reachable)
    coverage.add(reachable.configurations)
    assert coverage.share == 1.0 and coverage.nearest(np.array([0.0, 1.5, 0.5, 0.0]), 3).shape == (0, 4)


def test_the_next_cell_is_the_nearest_that_is_left(gantry: tuple[MachineSpecification, Arm]) -> None:
    machine, arm = gantry
    reachable, q = ReachableCells(machine, arm, FEW), np.array([0.1, 1.6, 0.7, 0.3])
    coverage = Coverage(reachable)
    visited = []
    for _ in range(40):
        (ahead,) = coverage.nearest(q, 1)
        distances = []
        for number, other in zip(reachable.numbers, reachable.configurations, strict=True):
            swing, out, up, tilt = other - q
            chord = 4 * other[1] * q[1] * math.sin(swing / 2) ** 2 + out**2  # law of cosines
            distances.append(((chord + up**2) / 0.24**2 + (tilt / 0.16) ** 2, number in visited))
        nearest = min(distance for distance, is_visited in distances if not is_visited)
        (number,) = reachable.cells_of(ahead[None])
        assert distances[list(reachable.numbers).index(number)] == (pytest.approx(nearest), False)
        visited.append(number)
        coverage.add(ahead[None])
    assert len(set(visited)) == 40 == coverage.n_visited
    together = coverage.nearest(q, 5)
    assert not set(reachable.cells_of(together)) & set(visited) and len(together) == 5


def test_a_cell_that_sampling_missed_counts_once_the_machine_was_there(
    gantry: tuple[MachineSpecification, Arm],
) -> None:
    machine, arm = gantry
    coverage = Coverage(ReachableCells(machine, arm, FEW))
    before = coverage.n_reachable
    coverage.add(np.array([[0.1, 2.3, 0.7, 0.3]]))  # beyond the limit, as an encoder's offset has it
    assert (coverage.n_visited, coverage.n_reachable) == (1, before + 1)


def test_a_machine_that_reaches_nothing_is_told(gantry: tuple[MachineSpecification, Arm]) -> None:
    machine, arm = gantry
    machine.joints[2].upper = 0.1
    machine.joints[2].lower = 0.0
    with pytest.raises(InputError, match="no configuration within the joints' limits lies in the workspace"):
        ReachableCells(machine, arm, FEW)
    with pytest.raises(InputError, match=r"coverage.cell_m is 0"):
        CoverageConfig(0.0, 0.1, 1.0, 4)
