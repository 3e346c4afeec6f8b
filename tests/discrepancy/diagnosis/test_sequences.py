"""Logs that begin in the midst of a motion: what is predicted there is as if the log had begun before."""

import jax
import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel, Scales, _initial, _inputs, _parts
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.logs.tuples import Trajectory

LAGS, N_JOINT, N_ROWS, DT_S, CUT = 6, 3, 300, 0.05, 137
LIMIT, BEYOND, SPEED = 2.0 * np.ones(N_JOINT), np.full(N_JOINT, np.inf), np.ones(N_JOINT)


def log(first: int) -> Trajectory:
    """The rows from `first` on of one recording."""
    random = np.random.default_rng(0)
    a = random.choice([-1.0, 0.0, 1.0], (N_ROWS // 10, N_JOINT)).repeat(10, axis=0)
    q = 0.01 * np.cumsum(a, axis=0)
    t_s = DT_S * np.arange(N_ROWS)
    columns = t_s, (1e9 * t_s).astype(np.int64), q, np.zeros_like(q), a, np.zeros(N_ROWS, bool)
    return Trajectory("cut", *(column[first:] for column in columns))


def velocities(sequences: Sequences, phase: float) -> np.ndarray:
    """Of a network that nobody has trained: (T, n_joint)."""
    scales = Scales(-LIMIT, LIMIT, SPEED, -BEYOND, BEYOND)
    n_in = _inputs(sequences.command, sequences.q, scales, LAGS, True).shape[-1]
    weights = jax.tree.map(lambda leaf: leaf[None], _initial(jax.random.key(0), n_in, 8, N_JOINT))
    model = DiagnosisModel(weights, scales, LAGS, DT_S, np.ones((1, 1, 1)), is_switched=True)
    simulation = Simulation(model, sequences, [Gain], Setting(DT_S, -LIMIT, LIMIT, SPEED))
    simulation = simulation.with_phases(np.array([phase]))
    return simulation.velocities([NOMINAL])[0, 0]


@pytest.mark.parametrize("phase", [-0.4, 0.0, 0.4])
def test_no_row_depends_on_commands_that_nobody_knows(phase: float) -> None:
    whole, cut = (side_by_side([log(first)], DT_S, LAGS) for first in (0, CUT))
    expected = velocities(whole, phase)[CUT:N_ROWS]
    found = velocities(cut, phase)[: N_ROWS - CUT]
    is_row = cut.is_row[0, : N_ROWS - CUT]
    np.testing.assert_allclose(found[is_row], expected[is_row], atol=1e-5)
    assert np.abs(found - expected)[LAGS - 2].max() > 1e-3


def test_a_log_keeps_all_its_rows_for_what_runs_along_it() -> None:
    trajectory = log(CUT)
    sequences = side_by_side([trajectory, log(N_ROWS - 4)], DT_S, LAGS)
    np.testing.assert_array_equal(sequences.command[0, : len(trajectory)], trajectory.a)
    np.testing.assert_array_equal(sequences.q[0, : len(trajectory)], trajectory.q)
    np.testing.assert_array_equal(np.flatnonzero(sequences.is_row[0]), np.arange(LAGS, N_ROWS - CUT - 1))
    assert not sequences.is_row[1].any()  # too short for a row


def test_every_row_has_a_member_that_did_not_see_it() -> None:
    """Also the one before the first that is used: of a log that is read late, half of it is in that one."""
    is_row = side_by_side([log(0), log(CUT), log(0)], DT_S, LAGS).is_row
    parts = _parts(is_row, 5)
    assert parts.min() == 0 and parts.max() == 4
    assert np.ptp(np.bincount(parts[is_row])) <= 1
    assert (np.diff(parts[is_row]) >= 0).all()
