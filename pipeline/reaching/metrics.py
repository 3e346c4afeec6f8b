"""Metrics of reaching from traces (paper, "Synthesis and evaluation of controllers for reaching")."""

import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pipeline.errors import InputError
from pipeline.machine.chain import Surfaces

# Thresholds of the success-rate matrices: position in m, pitch in rad (paper, section "Sim2Sim transfer")
POSITION_THRESHOLDS_M = tuple(n / 50 for n in range(1, 18))
PITCH_THRESHOLDS_RAD = tuple(n / 50 for n in range(1, 9))
# Pairs (position, pitch) that the tables report
REPORTED_PRECISIONS = ((0.02, 0.02), (0.04, 0.04), (0.12, 0.08))
# A tip so near a surface touches it: one count of a 13-bit encoder, 0.77 mrad, over a reach of 2.6 m
CONTACT_M = 0.002
# End of a path (appendix, EEF-PL; its "0.02 [cm]" is read as 0.02 m)
PATH_END_PRECISION = (0.02, 0.02)


class Traces(NamedTuple):
    """N episodes of T ticks; entry t is the state after tick t+1, so the start is not included.

    Attributes:
        q: configuration, rad (m), shape (N, T, n_joint).
        command: shape (N, T, n_joint).
        start_position: of the tip in {B} before the first tick, m, shape (N, 3).
        position: of the tip, m, shape (N, T, 3).
        position_error: distance to the target, m, shape (N, T).
        pitch_error: signed, rad, shape (N, T).
        inside: whether the pose lies in W+, boolean, shape (N, T).
        below: whether the tip is below W+'s lower plane, boolean, shape (N, T).
        reward: sum of the enabled terms, shape (N, T).
    """

    q: np.ndarray
    command: np.ndarray
    start_position: np.ndarray
    position: np.ndarray
    position_error: np.ndarray
    pitch_error: np.ndarray
    inside: np.ndarray
    below: np.ndarray
    reward: np.ndarray


@dataclass(frozen=True)
class ReachingMetrics:
    """Metrics over a set of episodes.

    Attributes:
        n_episodes: number of episodes N.
        average_return: undiscounted sum of rewards over an episode's ticks, averaged.
        sr_002_002: success rate at 0.02 m and 0.02 rad.
        sr_004_004: success rate at 0.04 m and 0.04 rad.
        sr_012_008: success rate at 0.12 m and 0.08 rad.
        oow: share of episodes in which the pose left W+ at any tick.
        ooz: share of episodes in which the tip went below W+'s lower plane at any tick.
        min_z_m: lowest tip position of all ticks of all episodes.
        path_length_m: path length of the tip until the target is reached within 0.02 m and 0.02 rad, or to the end;
            averaged.
        ground: share of episodes in which the tip met the ground, a grill on it, or the machine's base at any tick; NaN
            in a checkpoint from before there was this metric.
    """

    n_episodes: int
    average_return: float
    sr_002_002: float
    sr_004_004: float
    sr_012_008: float
    oow: float
    ooz: float
    min_z_m: float
    path_length_m: float
    ground: float = float("nan")

    def as_dict(self) -> dict[str, float]:
        """Metrics by name, for `metrics.json`."""
        return asdict(self)


def success_key(position_threshold_m: float, pitch_threshold_rad: float) -> str:
    """Name of a success rate: `sr_012_008` for 0.12 m and 0.08 rad."""
    return f"sr_{round(100 * position_threshold_m):03d}_{round(100 * pitch_threshold_rad):03d}"


def success(traces: Traces, position_threshold_m: float, pitch_threshold_rad: float) -> np.ndarray:
    """b_SR (Eq. b_sr) per tick, boolean, shape (N, T): both conditions hold at the same tick."""
    return (traces.position_error < position_threshold_m) & (np.abs(traces.pitch_error) < pitch_threshold_rad)


def success_rate(traces: Traces, position_threshold_m: float, pitch_threshold_rad: float) -> float:
    """SR: share of episodes with success at one tick at least."""
    return float(success(traces, position_threshold_m, pitch_threshold_rad).any(axis=1).mean())


def success_rate_matrix(traces: Traces) -> np.ndarray:
    """SR over `POSITION_THRESHOLDS_M` (rows) and `PITCH_THRESHOLDS_RAD` (columns), shape (17, 8)."""
    return np.array(
        [
            [success_rate(traces, position, pitch) for pitch in PITCH_THRESHOLDS_RAD]
            for position in POSITION_THRESHOLDS_M
        ]
    )


def path_lengths(traces: Traces) -> np.ndarray:
    """Path length of the tip per episode up to the tick that reaches the target, or over all ticks; m, shape (N,)."""
    positions = np.concatenate([traces.start_position[:, None, :], traces.position], axis=1).astype(
        np.float64
    )
    ways = np.linalg.norm(np.diff(positions, axis=1), axis=-1)
    reached = success(traces, *PATH_END_PRECISION)
    reached_before = np.cumsum(reached, axis=1) - reached > 0
    return np.where(reached_before, 0.0, ways).sum(axis=1)


def reaching_metrics(traces: Traces, surfaces: Surfaces) -> ReachingMetrics:
    """All metrics of the paper's tables, and contacts of the tip with surfaces."""
    return ReachingMetrics(
        n_episodes=len(traces.reward),
        average_return=float(traces.reward.sum(axis=1, dtype=np.float64).mean()),
        **{success_key(*precision): success_rate(traces, *precision) for precision in REPORTED_PRECISIONS},
        oow=float((~traces.inside).any(axis=1).mean()),
        ooz=float(traces.below.any(axis=1).mean()),
        min_z_m=float(traces.position[..., 2].min()),
        path_length_m=float(path_lengths(traces).mean()),
        ground=float((surfaces.gap(traces.position) <= CONTACT_M).any(axis=1).mean()),
    )


def load_traces(path: Path) -> Traces:
    """Read the `traces.npz` of an evaluation.

    Raises:
        InputError: the file is missing, or it does not hold traces.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            return Traces(**{name: content[name] for name in Traces._fields})
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; run the evaluation that writes it") from None
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a file of traces ({error}); write it anew") from None
