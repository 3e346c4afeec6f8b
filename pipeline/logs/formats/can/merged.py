"""Join the signals of several frames into rows of one value per joint."""

from collections.abc import Iterator

import numpy as np

LONGEST_PAUSE_NS = 1_000_000_000  # a frame that stays away longer does not hold the others up


class MergedFrames:
    """Rows from frames that each hold the values of some joints, within bounded memory.

    Positions are interpolated linearly to the times of the first frame. Commands have a row at every frame, with the
    last values of the others.
    """

    def __init__(self, joints: list[list[int]], n_joint: int, is_held: bool) -> None:
        self.joints, self.n_joint, self.is_held = joints, n_joint, is_held
        self.times: list[np.ndarray] = [np.zeros(0, np.int64) for _ in joints]
        self.values: list[np.ndarray] = [np.zeros((0, len(columns))) for columns in joints]
        self.emitted = -1
        self.n_late = 0

    def add(self, number: int, times: np.ndarray, values: np.ndarray) -> None:
        """Add samples of one frame, of shapes (n,) and (n, n_signals)."""
        is_late = times <= self.emitted if len(self.joints) > 1 else np.zeros(len(times), bool)
        self.n_late += int(is_late.sum())
        self.times[number] = np.concatenate([self.times[number], times[~is_late]])
        self.values[number] = np.concatenate([self.values[number], values[~is_late]])

    def rows(self, is_last: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows that are settled, of shapes (n,) and (n, n_joint)."""
        if len(self.joints) == 1:
            return self._of_one_frame()
        for number, times in enumerate(self.times):
            order = np.argsort(times, kind="stable")
            self.times[number], self.values[number] = times[order], self.values[number][order]
        ends = [int(times[-1]) for times in self.times if len(times)]
        if not ends:
            return np.zeros(0, np.int64), np.zeros((0, self.n_joint))
        newest = max(ends)
        settled = newest if is_last else max(min(ends), newest - LONGEST_PAUSE_NS)
        at = np.unique(np.concatenate(self.times)) if self.is_held else self.times[0]
        at = at[(at > self.emitted) & (at <= settled)]
        values = np.full((len(at), self.n_joint), np.nan)
        for number, columns in enumerate(self.joints):
            values[:, columns] = (_held if self.is_held else _interpolated)(
                at, self.times[number], self.values[number]
            )
        self.emitted = settled
        for number, times in enumerate(self.times):
            begin = max(int(np.searchsorted(times, settled, side="right")) - 1, 0)
            self.times[number], self.values[number] = times[begin:], self.values[number][begin:]
        return at, values

    def _of_one_frame(self) -> tuple[np.ndarray, np.ndarray]:
        times, own = self.times[0], self.values[0]
        values = np.full((len(times), self.n_joint), np.nan)
        values[:, self.joints[0]] = own
        self.times[0], self.values[0] = times[:0], own[:0]
        return times, values


def _held(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    if not len(times):
        return np.full((len(at), values.shape[1]), np.nan)
    index = np.searchsorted(times, at, side="right") - 1
    return np.where(index[:, None] < 0, np.nan, values[np.maximum(index, 0)])


def _interpolated(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    if not len(times):
        return np.full((len(at), values.shape[1]), np.nan)
    origin = times[0]
    found = np.stack(list(_columns(at - origin, times - origin, values)), axis=1)
    after = np.searchsorted(times, at, side="left").clip(max=len(times) - 1)
    before = np.maximum(np.searchsorted(times, at, side="right") - 1, 0)
    found[times[after] - times[before] > LONGEST_PAUSE_NS] = np.nan
    return found


def _columns(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> Iterator[np.ndarray]:
    for column in values.T:
        yield np.interp(at, times, column, left=np.nan, right=np.nan)
