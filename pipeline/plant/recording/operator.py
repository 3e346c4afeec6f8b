"""The scripted operator who paints the restricted workspace W+.

Source: paper, section "Data collection for system identification".

The operator looks at what has been painted so far, picks a place that has not, and goes there with two
sticks: discrete commands at the control rate, decided on measured joint angles that are one reaction time
old, switched off with more or less anticipation of the machine's run-out, with pauses, taps, moves of single
joints and changes of mind. Style is drawn by seed.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification, WorkspaceSpecification
from pipeline.plant.compiled import compiled
from pipeline.plant.physics.kinematics import configuration, place, tip

CANVAS_CELLS = (7, 8, 9)  # radius, yaw, height: cells of about 0.25 m
N_CANDIDATE = 24  # places that the operator considers before choosing
N_HEADING = 12  # samples of a straight joint motion that must stay in W+
PITCH_MAX_RAD = 1.047  # of goals (contract, section 1)
LIMIT_MARGIN_RAD = 0.02  # goals this far from the joint limits; going to a limit happens by overshoot
LONGEST_MOVE_S = 12.0  # then the operator changes his mind
TAP_S = (0.10, 0.45)  # shortest and longest tap
EXPECTED_SPEED_RAD_S = 0.35  # what the operator expects of a joint that is being moved
ORDER_SPREAD_RAD = 0.3  # how loosely the longest way comes first
SETTLE_S = 0.7  # how long the operator waits to see where the machine comes to rest
BORDER_TOLERANCE = 0.01  # how much farther outside W+ the operator lets the tip go
RUN_OUT_S = 0.35  # horizon of the tip's extrapolation when keeping it inside


@dataclass(frozen=True)
class OperatorStyle:
    """Habits of one operator. Times in s, angles in rad, probabilities per decision."""

    reaction_time_s: float
    anticipation_s: float  # run-out that the operator allows for when letting go
    tolerance_rad: float  # distance at which the goal counts as reached
    simultaneous: float  # mean number of joints that are moved at once
    pause_probability: float  # after arriving
    pause_mean_s: float
    single_joint_probability: float  # next goal changes one joint only
    tap_probability: float  # instead of a goal: a few short taps of one joint
    dither_probability: float  # per decision while moving: let go or grab another joint
    correction_probability: float  # after a move: correct towards the same goal
    pitch_spread_rad: float  # standard deviation of the pitch chosen at goals


def draw_style(seed: int) -> OperatorStyle:
    """An operator, drawn by seed."""
    random = np.random.default_rng(seed)
    return OperatorStyle(
        reaction_time_s=random.uniform(0.22, 0.36),
        anticipation_s=random.uniform(0.10, 0.30),
        tolerance_rad=random.uniform(0.03, 0.07),
        simultaneous=random.uniform(1.8, 3.0),
        pause_probability=random.uniform(0.3, 0.7),
        pause_mean_s=random.uniform(0.6, 1.6),
        single_joint_probability=random.uniform(0.15, 0.35),
        tap_probability=random.uniform(0.05, 0.12),
        dither_probability=random.uniform(0.005, 0.02),
        correction_probability=random.uniform(0.2, 0.5),
        pitch_spread_rad=random.uniform(0.4, 0.6),
    )


class Canvas:
    """W+ as cells of radius, yaw and height, with the number of visits of each."""

    def __init__(self, workspace: WorkspaceSpecification, n_radius: int, n_yaw: int, n_height: int) -> None:
        self._lower = np.array([workspace.radius_min_m, -workspace.yaw_max_rad, workspace.z_min_m])
        self._upper = np.array([workspace.radius_max_m, workspace.yaw_max_rad, workspace.z_max_m])
        self.bounds = np.stack([self._lower, self._upper])
        self._shape = np.array([n_radius, n_yaw, n_height])
        self.visits = np.zeros((n_radius, n_yaw, n_height), dtype=np.int64)

    def contains(self, point: np.ndarray) -> bool:
        """Whether (radius, yaw, height) lies in W+."""
        return outside(point, self.bounds) == 0.0

    def paint(self, q: np.ndarray) -> None:
        """Count the visit of joint angles (4,)."""
        paint(q, self.bounds, self.visits)

    def choose(self, random: np.random.Generator, n_candidate: int) -> np.ndarray:
        """Random points of W+, the least painted first; (n_candidate, 3)."""
        cells = random.integers(0, self._shape, size=(n_candidate, 3))
        order = np.argsort(self.visits[tuple(cells.T)], kind="stable")
        place = (cells[order] + random.random((n_candidate, 3))) / self._shape
        return self._lower + place * (self._upper - self._lower)


@compiled
def outside(point: np.ndarray | tuple[float, float, float], bounds: np.ndarray) -> float:
    """How far (radius, yaw, height) lies outside bounds (2, 3), metres and radians added up; zero inside."""
    total = 0.0
    for i in range(3):
        total += max(bounds[0, i] - point[i], 0.0) + max(point[i] - bounds[1, i], 0.0)
    return total


@compiled
def paint(q: np.ndarray, bounds: np.ndarray, visits: np.ndarray) -> None:
    """Count the visit of joint angles (4,) in its cell."""
    point, cell = place(q), [0, 0, 0]
    if outside(point, bounds) > 0.0:
        return
    for i in range(3):
        share = (point[i] - bounds[0, i]) / (bounds[1, i] - bounds[0, i])
        cell[i] = min(int(share * visits.shape[i]), visits.shape[i] - 1)
    visits[cell[0], cell[1], cell[2]] += 1


@compiled
def steer(
    goal: np.ndarray,
    soon: np.ndarray,
    tolerance: float,
    moving: np.ndarray,
    pending: np.ndarray,
    enabled: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """What is left to the goal, (n,) rad, and the commands towards it, int8; joints that arrive are let go for good."""
    left, direction = goal - soon, np.zeros_like(moving)
    for j in range(goal.size):
        if abs(left[j]) > tolerance:
            direction[j] = np.sign(left[j])
        if enabled[j] and (direction[j] == 0 or direction[j] * moving[j] < 0):
            pending[j] = enabled[j] = False
    return left, direction


@compiled
def leaves(
    q: np.ndarray, speed: np.ndarray, command: np.ndarray, horizon_s: float, bounds: np.ndarray
) -> bool:
    """Whether a command would move the tip out of the bounds, or farther out."""
    soon = q.copy()
    for j in range(q.size):
        expected = EXPECTED_SPEED_RAD_S * command[j] if command[j] != 0 else speed[j]
        soon[j] += expected * horizon_s
    return outside(place(soon), bounds) > outside(place(q), bounds) + BORDER_TOLERANCE


class ScriptedOperator:
    """A teleoperator in closed loop on measured joint angles."""

    def __init__(self, machine: MachineSpecification, style: OperatorStyle, seed: int) -> None:
        """An operator of `machine`, which must have a workspace and the four joints of an impact hammer.

        Raises:
            InputError: the machine has no workspace.
        """
        if machine.workspace is None:
            raise InputError(
                f"conf/machine/{machine.name}.yaml: workspace is missing; the operator paints it"
            )
        self._style = style
        self._random = np.random.default_rng(seed)
        self._dt_s = machine.dt_s
        self._lower, self._upper = machine.lower, machine.upper
        self.canvas = Canvas(machine.workspace, *CANVAS_CELLS)
        self._seen: list[np.ndarray] = []
        self._goal: np.ndarray | None = None
        self._pending = np.zeros(machine.n_joint, dtype=bool)  # still to be moved towards the goal
        self._enabled = np.zeros(machine.n_joint, dtype=bool)  # joints whose stick is held
        self._moving = np.zeros(machine.n_joint, dtype=np.int8)
        self._wait_s = 0.0
        self._elapsed_s = 0.0
        self._taps: list[tuple[np.ndarray, int]] = []

    @property
    def goal(self) -> np.ndarray | None:
        """Joint angles that the operator heads for, or None while pausing."""
        return self._goal

    def command(self, measured: np.ndarray) -> np.ndarray:
        """The sticks' position for this control period.

        Args:
            measured: newest joint angles, (4,), rad.

        Returns:
            Commands, (4,), int8 in {-1, 0, 1}.
        """
        self._seen.append(np.array(measured))
        self.canvas.paint(self._seen[-1])
        n_reaction = max(round(self._style.reaction_time_s / self._dt_s), 1)
        q = self._seen[max(len(self._seen) - 1 - n_reaction, 0)]
        q_before = self._seen[max(len(self._seen) - 1 - 2 * n_reaction, 0)]
        speed = (q - q_before) / (n_reaction * self._dt_s)
        if len(self._seen) > 4 * n_reaction:
            del self._seen[: -3 * n_reaction]

        if self._wait_s > 0.0:
            self._wait_s -= self._dt_s
            return np.zeros_like(self._moving)
        if self._taps:
            return self._tap()
        if self._goal is None:
            self._decide(q)
        return self._steer(q, speed)

    def _tap(self) -> np.ndarray:
        command, left = self._taps[0]
        if left <= 1:
            self._taps.pop(0)
        else:
            self._taps[0] = (command, left - 1)
        return command.copy()

    def _decide(self, q: np.ndarray) -> None:
        """Choose the next goal: an unpainted place, a single-joint move, or a few taps."""
        random, style = self._random, self._style
        self._elapsed_s = 0.0
        if random.random() < style.tap_probability:
            joint = random.integers(q.size)
            for _ in range(random.integers(1, 4)):
                on = np.zeros(q.size, dtype=np.int8)
                on[joint] = random.choice([-1, 1])
                self._taps.append((on, round(random.uniform(*TAP_S) / self._dt_s)))
                self._taps.append((np.zeros_like(on), round(random.uniform(*TAP_S) / self._dt_s)))
            self._goal = None
            return
        goals = self._goals(q)
        if not goals:
            self._goal = None
            self._wait_s = style.pause_mean_s
            return
        goal = goals[0]
        if random.random() < style.single_joint_probability:
            joint = random.integers(q.size)
            goal = np.where(np.arange(q.size) == joint, goal, q)
        self._goal = goal
        self._pending[:] = np.abs(goal - q) > style.tolerance_rad
        self._enabled[:] = False
        self._grab(goal - q)

    def _goals(self, q: np.ndarray) -> list[np.ndarray]:
        """Reachable configurations in unpainted places; those whose way stays inside W+ come first."""
        inside: list[np.ndarray] = []
        through: list[np.ndarray] = []
        for cell in self.canvas.choose(self._random, N_CANDIDATE):
            pitch = self._style.pitch_spread_rad * float(self._random.standard_normal())
            pitch = min(max(pitch, -PITCH_MAX_RAD), PITCH_MAX_RAD)
            goal = configuration(cell[[0, 2]], pitch, cell[1])
            if goal is None or np.any(goal < self._lower + LIMIT_MARGIN_RAD):
                continue
            if np.any(goal > self._upper - LIMIT_MARGIN_RAD):
                continue
            way = q + np.linspace(0.0, 1.0, N_HEADING)[:, None] * (goal - q)
            radius_height, _ = tip(way)
            points = np.stack([radius_height[:, 0], way[:, 0], radius_height[:, 1]], axis=-1)
            stays = all(self.canvas.contains(point) for point in points[1:])
            (inside if stays else through).append(goal)
        return inside + through

    def _steer(self, q: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Bang-bang towards the goal with anticipation, one group of joints after the other.

        A joint that was let go is left alone until the move is over: people look before they correct.
        """
        style, random = self._style, self._random
        if self._goal is None:
            return np.zeros_like(self._moving)
        soon = q + speed * (style.reaction_time_s + style.anticipation_s)
        left, direction = steer(
            self._goal, soon, style.tolerance_rad, self._moving, self._pending, self._enabled
        )
        if random.random() < style.dither_probability:
            self._enabled[random.integers(q.size)] ^= True
            self._enabled &= self._pending
        if not self._enabled.any():
            self._grab(left)
        command = direction * (self._enabled & self._pending)
        self._elapsed_s += self._dt_s
        if not self._pending.any() or self._elapsed_s > LONGEST_MOVE_S:
            self._finish(left)
            command[:] = 0
        self._moving = self._kept_inside(q, speed, command)
        return self._moving

    def _grab(self, left: np.ndarray) -> None:
        """Take hold of the next joints, mostly those with the longest way to go."""
        n_once = int(np.clip(self._random.poisson(self._style.simultaneous - 1.0) + 1, 1, left.size))
        order = np.argsort(-np.abs(left) * self._pending + ORDER_SPREAD_RAD * self._random.random(left.size))
        self._enabled[order[:n_once]] = True
        self._enabled &= self._pending

    def _finish(self, left: np.ndarray) -> None:
        """After a move: correct joints that are far off, or go on; sometimes pause."""
        if self._random.random() < self._style.correction_probability:
            self._pending[:] = np.abs(left) > self._style.tolerance_rad
            self._wait_s = SETTLE_S
            self._elapsed_s = 0.0
            if self._pending.any():
                return
        self._goal = None
        if self._random.random() < self._style.pause_probability:
            self._wait_s = self._random.exponential(self._style.pause_mean_s)

    def _kept_inside(self, q: np.ndarray, speed: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Release joints that would move the tip out of W+ in height or radius."""
        if not leaves(q, speed, command, self._style.reaction_time_s + RUN_OUT_S, self.canvas.bounds):
            return command
        self._goal = None
        self._wait_s = max(SETTLE_S, self._random.exponential(self._style.pause_mean_s))
        return np.zeros_like(command)
