"""Logs that begin in the midst of a motion: what is predicted there is as if the log had begun before."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel, left_out_rows
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.training.ensemble_loss import part_bounds
from pipeline.dynamics.training.windows import window_starts
from pipeline.effects.effect import Setting
from pipeline.effects.gain import Gain
from pipeline.logs.tuples import Trajectory
from tests.dynamics.conftest import make_fir_specification

LAGS, N_JOINT, N_ROWS, DT_S, CUT = 6, 3, 300, 0.05, 137
LIMIT, SPEED = 2.0 * np.ones(N_JOINT), np.ones(N_JOINT)


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
    model = FirModel(make_fir_specification(2.0, SPEED, LAGS - 1, hidden=[8], demand_beyond=[1]))
    network = DiagnosisModel(model, model.initialise(jax.random.key(0)), np.ones((1, 1, 1)))
    simulation = Simulation(network, sequences, [Gain], Setting(DT_S, -LIMIT, LIMIT, SPEED))
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
    logs, n_members = [replace(log(0), is_validation=np.arange(N_ROWS) >= 250), log(CUT), log(0)], 5
    left_out = left_out_rows(logs, N_ROWS + 7, LAGS - 1, n_members)
    assert left_out.shape == (n_members, 3, N_ROWS + 7)
    np.testing.assert_array_equal(left_out.sum(axis=0), 1)
    parts = np.argmax(left_out, axis=0)
    assert (np.diff(parts.ravel()) >= 0).all()
    # the same parts as those that the training loss leaves out
    starts = window_starts(logs, validation=False, first_row=LAGS, horizon=1)
    learned = np.searchsorted(part_bounds(starts, n_members), starts, side="right")
    rows = np.concatenate([parts[number, : len(of)] for number, of in enumerate(logs)])
    np.testing.assert_array_equal(rows[starts], learned)
    assert np.ptp(np.bincount(learned)) <= 1
