"""What share of W+ the tip has visited, and where it has not been.

An operator who records data "paints" the interior of W+ with the tip (paper, "Data collection for system
identification"). W+ is cut into cells of position and pitch. Of these, the share counts the ones that the machine can
reach, which sampled configurations tell.
"""

import math

import numpy as np

from pipeline.deployment.settings import CoverageConfig
from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import MachineSpecification, WorkspaceSpecification
from pipeline.machine.workspace import workspace_of

BATCH = 2**16  # configurations at a time: some 10 MB of arrays
ROUNDING = 1e-9  # relative: an extent of 3.0000000001 cells has three


class Cells:
    """Cells of equal edges: rings about the swing axis, cut into columns, layers and bins of pitch.

    Attributes:
        n: How many there are, bins of pitch included.
    """

    def __init__(self, workspace: WorkspaceSpecification, config: CoverageConfig) -> None:
        self._workspace, self._pitch_max = workspace, config.pitch_max_rad
        near, far = workspace.radius_min_m, workspace.radius_max_m
        self._rings = _parts(far - near, config.cell_m)
        outer = np.linspace(near, far, self._rings + 1)[1:]
        self._columns = np.array([_parts(2 * workspace.yaw_max_rad * r, config.cell_m) for r in outer])
        self._before = np.cumsum(self._columns) - self._columns  # columns of the rings further inside
        self._layers = _parts(workspace.z_max_m - workspace.z_min_m, config.cell_m)
        self._bins = _parts(2 * config.pitch_max_rad, config.pitch_bin_rad)
        self.n = int(self._columns.sum()) * self._layers * self._bins

    def locate(
        self, position: np.ndarray, yaw: np.ndarray, pitch: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """The cells of poses, as `pipeline.machine.workspace.contains` has them inside.

        Args:
            position: of the chisel tip in {B}, m, (N, 3).
            yaw: of the arm's plane, rad, (N,).
            pitch: rad, (N,).

        Returns:
            Numbers of the cells, (N,), -1 outside; distances from the cells' middles, (N,), 1 on a face.
        """
        w, (x, y, z) = self._workspace, position.T
        in_front = x * np.cos(yaw) + y * np.sin(yaw) > 0.0
        radius = np.where(in_front, np.hypot(x, y), -1.0)
        ring, off_radius = _part(radius, w.radius_min_m, w.radius_max_m, self._rings)
        column, off_yaw = _part(yaw, -w.yaw_max_rad, w.yaw_max_rad, self._columns[ring])
        layer, off_z = _part(z, w.z_min_m, w.z_max_m, self._layers)
        level, off_pitch = _part(pitch, -self._pitch_max, self._pitch_max, self._bins)
        number = ((self._before[ring] + column) * self._layers + layer) * self._bins + level
        outside = np.minimum.reduce([ring, column, layer, level]) < 0
        off = np.maximum.reduce([off_radius, off_yaw, off_z, off_pitch])
        return np.where(outside, -1, number), off


class ReachableCells:
    """The cells of W+ that a machine can reach, each with the sampled configuration nearest to its middle.

    Configurations are drawn uniformly within the joints' limits. A cell that is missed is one that few configurations
    reach: one in `samples_per_cell` of the mean is missed with a probability of 1/e.

    Attributes:
        n: Number of all cells.
        numbers: Cells that can be reached, (m,), ascending.
        configurations: One for each of them, (m, n_joint), rad (m).
    """

    def __init__(self, machine: MachineSpecification, arm: Arm, config: CoverageConfig) -> None:
        """Sample; takes about a second per million configurations.

        Raises:
            InputError: The machine has no workspace, or no sampled configuration lies in it.
        """
        self.config, self.arm = config, arm
        self._cells = Cells(workspace_of(machine), config)
        self.n = self._cells.n
        random = np.random.default_rng(0)
        numbers, offs = np.zeros(0, int), np.zeros(0)
        configurations = np.zeros((0, machine.n_joint))
        for _ in range(-(-config.samples_per_cell * self.n // BATCH)):
            q = random.uniform(machine.lower, machine.upper, (BATCH, machine.n_joint))
            number, off = self._locate(q)
            inside = number >= 0
            numbers = np.concatenate([numbers, number[inside]])
            offs = np.concatenate([offs, off[inside]])
            configurations = np.concatenate([configurations, q[inside]])
            order = np.lexsort((offs, numbers))
            best = order[np.unique(numbers[order], return_index=True)[1]]
            numbers, offs, configurations = numbers[best], offs[best], configurations[best]
        if not len(numbers):
            raise InputError(
                f"conf/machine/{machine.name}.yaml: no configuration within the joints' limits lies in the workspace "
                f"with a pitch within {config.pitch_max_rad} rad; correct limits, arm or workspace"
            )
        self.numbers, self.configurations = numbers, configurations
        self.position, self.pitch = arm.forward(configurations).position, arm.pitch(configurations)

    def cells_of(self, q: np.ndarray) -> np.ndarray:
        """Numbers of the cells of configurations (N, n_joint), rad (m): (N,), -1 outside W+."""
        return self._locate(q)[0]

    def _locate(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self._cells.locate(self.arm.forward(q).position, self.arm.yaw(q), self.arm.pitch(q))


class Coverage:
    """What the tip has visited so far."""

    def __init__(self, reachable: ReachableCells) -> None:
        """Nothing is visited yet."""
        self._reachable = reachable
        self._is_visited = np.zeros(reachable.n, bool)
        self._is_reachable = np.zeros(reachable.n, bool)
        self._is_reachable[reachable.numbers] = True

    def add(self, q: np.ndarray) -> None:
        """Count configurations (N, n_joint), rad (m). Where the machine has been, it can be."""
        cells = self._reachable.cells_of(q)
        cells = cells[cells >= 0]
        self._is_visited[cells] = True
        self._is_reachable[cells] = True

    @property
    def n_visited(self) -> int:
        """Number of cells visited."""
        return int(self._is_visited.sum())

    @property
    def n_reachable(self) -> int:
        """Number of cells that can be reached."""
        return int(self._is_reachable.sum())

    @property
    def share(self) -> float:
        """Visited part of what can be reached, from 0 to 1."""
        return self.n_visited / self.n_reachable

    def nearest(self, q: np.ndarray, n: int) -> np.ndarray:
        """Where to go next: configurations of the nearest cells that are not visited yet.

        Distances are those of the tip's position and pitch, in edges of a cell and widths of a bin.

        Args:
            q: Where the machine is, (n_joint,), rad (m).
            n: How many cells.

        Returns:
            (n, n_joint), rad (m), the nearest first; fewer rows where fewer are left.
        """
        reachable, config = self._reachable, self._reachable.config
        left = np.flatnonzero(~self._is_visited[reachable.numbers])
        away = (reachable.position[left] - reachable.arm.forward(q).position) / config.cell_m
        turn = (reachable.pitch[left] - reachable.arm.pitch(q)) / config.pitch_bin_rad
        order = np.argsort((away**2).sum(axis=1) + turn**2, kind="stable")
        return reachable.configurations[left[order[:n]]]


def _parts(extent: float, longest: float) -> int:
    """Into how many equal parts an extent is cut, of which none is longer than `longest`."""
    return math.ceil(extent / longest * (1.0 - ROUNDING))


def _part(
    value: np.ndarray, lower: float, upper: float, parts: int | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """In which part of an interval values lie, -1 outside, and how far from its middle, in halves of it."""
    inside = (value >= lower) & (value <= upper)
    at = (np.where(inside, value, lower) - lower) / (upper - lower) * parts
    part = np.minimum(at.astype(int), parts - 1)  # the upper bound belongs to the last part
    return np.where(inside, part, -1), np.abs(2.0 * (at - part) - 1.0)
