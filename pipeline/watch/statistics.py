"""What one session says of each joint: a few numbers that a change of the machine moves.

All are of the residual r = v - u: measured velocity less that of the nominal machine, both in units of the joint's
usual speed. u is that of the diagnosis model, which is driven by commands and positions alone, so that r shows all of
an effect. r is averaged over two rows.

    r  =  g+ max(u, 0) + g- min(u, 0) - l du/dt + d at_rest + r'     least squares, per joint

Each further coefficient is of r' on one more column. None names a cause, which `close_loop` does.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.scored_rows import averaged
from pipeline.dynamics.model.shown_motion import STANDING_SHARE


class Statistic(NamedTuple):
    """One of them.

    Attributes:
        name: In documents.
        unit: `1`, shares of the usual speed, or `s`.
        least: The smallest change worth telling.
        limit: Where a machine should not be worked with: up to there a trend is followed. None: it has no such size.
    """

    name: str
    unit: str
    least: float
    limit: float | None


# Changes of speed below 3 % are not worth a name: half of what `search.smallest_share` asks of the squares. The phase
# of a recording is half a step, 25 ms, and is misjudged now and then. Columns that are there for a part of the rows ask
# for as much of the speed there. All set by hand, `spread` and `lateness` with two simulated machines in view.
STATISTICS = (
    Statistic("speed_forward", "1", 0.03, 0.3),
    Statistic("speed_backward", "1", 0.03, 0.3),
    Statistic("lateness", "s", 0.03, 0.3),
    Statistic("drift", "1", 0.005, 0.1),
    Statistic("demand", "1", 0.03, 0.3),
    Statistic("position", "1", 0.03, 0.3),
    Statistic("ends", "1", 0.06, 0.6),
    Statistic("warming", "1", 0.06, 0.6),
    Statistic("starts", "1", 0.06, 0.6),
    Statistic("reversals", "1", 0.06, 0.6),
    Statistic("spread", "1", 0.6, None),  # of the logarithm
)
N_FIRST = 4  # that are fitted together
WARM_S = 300.0  # warming over longer times is a change of speed of a whole session
START_S = 0.5  # since a joint began to move: what a spool or lost motion holds back shows within it
REST_S = 0.5  # without motion, for a start to be one after a rest
# Of rows, for the spread: a log whose clock makes commands a step late now and then differs on the others.
CENTRAL = 0.95
RIDGE = 1e-3  # of the mean square of a column of its usual size: without a row that shows it, its coefficient is 0


class Rows(NamedTuple):
    """One stretch of a log on the machine's grid, beside what the nominal machine would have done.

    Attributes:
        command: (T, n_joint).
        q: (T, n_joint) [rad, m].
        velocity: (T, n_joint) measured [rad/s, m/s].
        nominal: (T, n_joint) of the diagnosis model, at the log's own phase [rad/s, m/s].
        time_s: (T,) since the log's start.
        counts: (T, n_joint) bool: rows of which nominal logs say something.
    """

    command: np.ndarray
    q: np.ndarray
    velocity: np.ndarray
    nominal: np.ndarray
    time_s: np.ndarray
    counts: np.ndarray


class Scale(NamedTuple):
    """Of a machine's joints: (n_joint,) limits [rad, m] and usual speeds [rad/s, m/s], and the time step [s]."""

    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    dt_s: float


def session_statistics(stretches: list[Rows], scale: Scale, least_s: float) -> np.ndarray:
    """(n_joint, n_statistic) as in `STATISTICS`; NaN for a joint that moves for less than `least_s` in the session."""
    found = np.full((len(scale.speed), len(STATISTICS)), np.nan)
    for joint in np.flatnonzero(moved_s(stretches, scale) >= least_s).tolist():
        found[joint] = _fitted(np.concatenate([_regression(rows, scale, joint) for rows in stretches]))
    return found


def moved_s(stretches: list[Rows], scale: Scale) -> np.ndarray:
    """(n_joint,) time [s] for which the nominal machine would move a joint, of rows that count."""
    moving = [np.sum(_moves(rows.nominal / scale.speed) & rows.counts, axis=0) for rows in stretches]
    return np.asarray(np.sum(moving, axis=0) * scale.dt_s)


def _moves(share: np.ndarray) -> np.ndarray:
    """Whether a joint moves, by shares of its usual speed."""
    return np.abs(share) > STANDING_SHARE


def _regression(rows: Rows, scale: Scale, joint: int) -> np.ndarray:
    """(N, 2 + n) counts, residual, columns, each averaged over two rows."""
    share = rows.nominal / scale.speed
    counts = rows.counts[:, joint].astype(float)
    residual = (rows.velocity - rows.nominal)[:, joint] / scale.speed[joint]
    columns = [
        counts,
        residual * counts,
        *(column * counts for column in _columns(rows, scale, share, joint)),
    ]
    every = np.ones((1, len(counts)), bool)
    return averaged(np.stack(columns, axis=-1)[None], every)


def _columns(rows: Rows, scale: Scale, share: np.ndarray, joint: int) -> list[np.ndarray]:
    """What the residual is regressed on, (T,) each, in units of the usual speed."""
    u = share[:, joint]
    moves = _moves(u)
    others = np.abs(np.delete(share, joint, axis=1)).sum(axis=1)
    range_ = scale.upper[joint] - scale.lower[joint]
    place = 2.0 * (rows.q[:, joint] - scale.lower[joint]) / range_ - 1.0
    begun, turned = _starts(u, moves, scale.dt_s)
    return [
        np.maximum(u, 0.0),
        np.minimum(u, 0.0),
        -np.gradient(u, scale.dt_s) if len(u) > 1 else np.zeros(len(u)),
        (~moves & (rows.command[:, joint] == 0.0)).astype(float),
        u * others,
        u * place,
        u * np.clip(2.0 * np.abs(place) - 1.0, 0.0, 1.0) * (u * place > 0.0),
        u * np.exp(-rows.time_s / WARM_S),
        u * begun,
        u * turned,
    ]


def _starts(u: np.ndarray, moves: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
    """(T,) bool, whether a joint has begun to move lately: after a rest; in the direction other than before."""
    row = np.arange(len(u))
    sign = np.where(moves, np.sign(u), 0.0)
    before = np.concatenate(
        [[-1], np.maximum.accumulate(np.where(moves, row, -1))[:-1]]
    )  # last row in motion
    starts = moves & (np.concatenate([[0.0], sign[:-1]]) != sign)
    rested = starts & (row - before > REST_S / dt_s)
    turned = starts & (before >= 0) & (sign[before] == -sign)
    start = np.maximum.accumulate(np.where(starts, row, 0))
    is_recent = moves & (row - start < START_S / dt_s)
    return is_recent & rested[start], is_recent & turned[start]


def _fitted(rows: np.ndarray) -> np.ndarray:
    counts, residual, columns = rows[:, 0], rows[:, 1], rows[:, 2:]
    first, further = columns[:, :N_FIRST], columns[:, N_FIRST:]
    # A column that is there on few rows is weighed like one that is there on a hundredth of them.
    ridge = RIDGE * np.maximum(np.sum(columns**2, axis=0), 1e-2 * max(counts.sum(), 1.0))
    gram = first.T @ first + np.diag(ridge[:N_FIRST])
    found = np.linalg.solve(gram, first.T @ residual)
    left = residual - first @ found
    # What a column has of the first ones is told by these.
    own = further - first @ np.linalg.solve(gram, first.T @ further)
    each = own.T @ left / (np.sum(own**2, axis=0) + ridge[N_FIRST:])
    squares = left[counts > 0.0] ** 2
    usual = squares[squares <= np.quantile(squares, CENTRAL)]
    spread = 0.5 * np.log(np.mean(usual) + 1e-12)
    return np.concatenate([found, each, [spread]])
