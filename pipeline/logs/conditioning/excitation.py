"""Excitation of a log: command statistics per joint, delays, and gaps in the data."""

from collections.abc import Iterable
from typing import Self

import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification

AT_REST_BEFORE_ROWS = 10  # half a second at 20 Hz; delays need starts from rest
MOTION_OF_RANGE = 0.002  # distance from the rest position that counts as motion
MOTION_IN_NOISE = 5.0  # and in standard deviations of the rest noise
LONGEST_DELAY_S = 3.0
FEW_STARTS = 5
ALONE_AT_LEAST_S = 2.0
COVERED_OF_RANGE = 0.5
NEAR_LIMIT_OF_RANGE = 0.02

Figures = dict[str, float | int | None]


class Excitation:
    """Measures per joint what a log's commands did, from trajectories that come section by section.

    Consecutive sections of one name are one trajectory; the sectioning does not change the result.
    """

    def __init__(self, machine: MachineSpecification, frozen_after_s: float) -> None:
        self.machine = machine
        self.horizon = round(LONGEST_DELAY_S * machine.rate_hz)
        self.frozen_rows = round(frozen_after_s * machine.rate_hz)
        n_joint = machine.n_joint
        self.n_rows = 0
        self.n_positive, self.n_negative, self.n_alone, self.n_starts, self.n_frozen = np.zeros(
            (5, n_joint), np.int64
        )
        self.magnitude = np.zeros(n_joint)
        self.lowest, self.highest = np.full(n_joint, np.inf), np.full(n_joint, -np.inf)
        self.fastest = np.zeros(n_joint)
        self.delays: list[list[np.ndarray]] = [[] for _ in range(n_joint)]
        self.name = ""
        self.still_rows = np.zeros(n_joint, np.int64)  # rows for which each encoder has repeated its value
        self.q, self.a = np.zeros((2, 0, n_joint))  # rows of unfinished starts, with their context
        self.n_settled = 0

    @classmethod
    def of(
        cls, trajectories: Iterable[Trajectory], machine: MachineSpecification, frozen_after_s: float
    ) -> Self:
        """Measure trajectories."""
        excitation = cls(machine, frozen_after_s)
        for trajectory in trajectories:
            excitation.add(trajectory)
        excitation.end_trajectory()
        return excitation

    def add(self, section: Trajectory) -> None:
        """Add the next section of a trajectory."""
        if section.name != self.name:
            self.end_trajectory()
            self.name = section.name
        active = section.a != 0
        self.n_rows += len(section)
        self.n_positive += (section.a > 0).sum(axis=0)
        self.n_negative += (section.a < 0).sum(axis=0)
        self.n_alone += (active & (active.sum(axis=1) == 1)[:, None]).sum(axis=0)
        self.magnitude += np.abs(section.a).sum(axis=0)
        self.lowest = np.minimum(self.lowest, section.q.min(axis=0))
        self.highest = np.maximum(self.highest, section.q.max(axis=0))
        self.fastest = np.maximum(self.fastest, np.abs(section.qd).max(axis=0))
        self._count_frozen(section)
        self.q, self.a = np.concatenate([self.q, section.q]), np.concatenate([self.a, section.a])
        self._settle(max(len(self.q) - self.horizon, self.n_settled))

    def end_trajectory(self) -> None:
        """Finish the pending starts; the next section begins a new trajectory."""
        self._settle(len(self.q))
        self.n_frozen += self.still_rows >= self.frozen_rows
        self.still_rows[:] = 0
        self.q, self.a, self.n_settled, self.name = self.q[:0], self.a[:0], 0, ""

    def position_range(self, joint: int) -> Figures:
        """Return the range of positions and the speeds."""
        return {
            "position_min": float(self.lowest[joint]),
            "position_max": float(self.highest[joint]),
            "speed_max": float(self.fastest[joint]),
        }

    def command_statistics(self, joint: int) -> Figures:
        """Return shares of time, number of starts, and durations of commands."""
        n_active = int(self.n_positive[joint] + self.n_negative[joint])
        n_starts = int(self.n_starts[joint])
        return {
            "share_negative": float(self.n_negative[joint] / self.n_rows),
            "share_zero": float((self.n_rows - n_active) / self.n_rows),
            "share_positive": float(self.n_positive[joint] / self.n_rows),
            "mean_magnitude_when_active": float(self.magnitude[joint] / n_active) if n_active else None,
            "n_starts": n_starts,
            "mean_active_s": float(n_active * self.machine.dt_s / n_starts) if n_starts else None,
            "alone_s": float(self.n_alone[joint] * self.machine.dt_s),
        }

    def apparent_delay_s(self, joint: int) -> tuple[float | None, int]:
        """Return the time from a command's start to the joint's first visible motion, over starts from rest.

        Motion is visible once the distance from the rest position, in either direction, exceeds both
        `MOTION_OF_RANGE` times the joint's range and `MOTION_IN_NOISE` times the rest noise. The moment is
        interpolated between rows. The delay includes dead time, the start of the response, and the clocks' offset.

        Returns:
            Median in s (None without such starts), and the number of starts.
        """
        delays = np.concatenate([*self.delays[joint], np.zeros(0)]) * self.machine.dt_s
        return (float(np.median(delays)) if len(delays) else None), len(delays)

    def frozen_stretches(self, joint: int) -> int:
        """Return how often the position repeated exactly under command, away from the limits."""
        return int(self.n_frozen[joint])

    def findings(self) -> list[str]:
        """Return what the data lack for later stages, one sentence each."""
        sentences = []
        for number, joint in enumerate(self.machine.joints):
            statistics = self.command_statistics(number)
            for direction, share in (("negative", "share_negative"), ("positive", "share_positive")):
                if statistics[share] == 0:
                    sentences.append(f"{joint.name} is never commanded in {direction} direction.")
            if not statistics["n_starts"]:
                continue
            if (statistics["alone_s"] or 0.0) < ALONE_AT_LEAST_S:
                sentences.append(
                    f"{joint.name} moves alone for {statistics['alone_s']:.1f} s only: its own response and what "
                    "the other joints take from it cannot be told apart."
                )
            if statistics["n_starts"] < FEW_STARTS:
                sentences.append(f"{joint.name} is started {statistics['n_starts']} times only.")
            covered = float(self.highest[number] - self.lowest[number]) / (joint.upper - joint.lower)
            if covered < COVERED_OF_RANGE:
                sentences.append(f"{joint.name} covers {covered:.0%} of its range.")
        return sentences

    def _count_frozen(self, section: Trajectory) -> None:
        """Count each encoder's runs of exact repetition under command, inside its limits."""
        margin = NEAR_LIMIT_OF_RANGE * (self.machine.upper - self.machine.lower)
        inside = (section.q > self.machine.lower + margin) & (section.q < self.machine.upper - margin)
        before = self.q[-1:] if len(self.q) else np.full((1, self.machine.n_joint), np.nan)
        still = (np.diff(section.q, axis=0, prepend=before) == 0) & (section.a != 0) & inside
        for joint in range(self.machine.n_joint):
            edges = np.flatnonzero(np.diff(still[:, joint], prepend=False, append=False))
            begin, end = edges[::2], edges[1::2]
            lengths = end - begin
            carried = self.still_rows[joint]
            goes_on = len(begin) > 0 and begin[0] == 0
            if goes_on:
                lengths[0] += carried
            elif carried >= self.frozen_rows:
                self.n_frozen[joint] += 1
            is_open = len(end) > 0 and end[-1] == len(section)
            self.still_rows[joint] = lengths[-1] if is_open else 0
            self.n_frozen[joint] += int((lengths[: len(lengths) - is_open] >= self.frozen_rows).sum())

    def _settle(self, end: int) -> None:
        """Measure the starts up to a row, and drop rows that later starts do not need."""
        for joint in range(self.machine.n_joint):
            q, a = self.q[:, joint], self.a[:, joint]
            rows = _starts(a, max(self.n_settled, 1), end)
            self.n_starts[joint] += len(rows)
            span = self.machine.upper[joint] - self.machine.lower[joint]
            delays = _delays_in_rows(q, a, rows, MOTION_OF_RANGE * span, self.horizon)
            if len(delays):
                self.delays[joint].append(delays)
        begin = max(end - AT_REST_BEFORE_ROWS, 0)
        self.q, self.a, self.n_settled = self.q[begin:], self.a[begin:], end - begin


def _starts(a: np.ndarray, begin: int, end: int) -> np.ndarray:
    """Rows from `begin` to `end` at which a command leaves zero."""
    return (
        np.flatnonzero((a[begin:end] != 0) & (a[begin - 1 : end - 1] == 0)) + begin if end > begin else _NONE
    )


_NONE = np.zeros(0, np.int64)


def _delays_in_rows(
    q: np.ndarray, a: np.ndarray, rows: np.ndarray, least_distance: float, horizon: int
) -> np.ndarray:
    """Measure the delay in rows of each start from rest that is followed by motion, shape (n_delays,)."""
    rows = rows[(rows >= AT_REST_BEFORE_ROWS) & (rows + 1 < len(a))]
    before = rows[:, None] + np.arange(-AT_REST_BEFORE_ROWS, 0)
    at_rest = (a[before] == 0).all(axis=1)
    rows, before = rows[at_rest], before[at_rest]
    if not len(rows):
        return np.zeros(0)
    threshold = np.maximum(least_distance, MOTION_IN_NOISE * q[before].std(axis=1))
    after = rows[:, None] + np.arange(horizon)
    within = after < len(a)
    after = np.minimum(after, len(a) - 1)
    held = np.logical_and.accumulate(within & (np.sign(a[after]) == np.sign(a[rows])[:, None]), axis=1)
    distance = np.abs(q[after] - q[before].mean(axis=1)[:, None])
    beyond = held & (distance > threshold[:, None])
    first = beyond.argmax(axis=1)
    moved = np.flatnonzero(beyond.any(axis=1) & (first > 0))  # row 0 means motion before the start
    last, threshold = first[moved], threshold[moved]
    nearer, farther = distance[moved, last - 1], distance[moved, last]
    return last - 1 + np.clip((threshold - nearer) / (farther - nearer), 0.0, 1.0)
