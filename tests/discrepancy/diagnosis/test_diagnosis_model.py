"""The diagnosis model against a machine in closed form, driven as its nominal logs hardly show."""

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.diagnosis_model import Scales, is_known, train_diagnosis_model
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.settings import CloseLoopConfig

N_JOINT, DT_S, SUPPLY = 4, 0.05, 2.0
SPEED = np.array([0.5, 0.4, 0.6, 0.7])
LOWER, UPPER = -2.0 * np.ones(N_JOINT), 2.0 * np.ones(N_JOINT)
UNBOUNDED = np.full(N_JOINT, np.inf)
SCALES = Scales(LOWER, UPPER, SPEED, -UNBOUNDED, UNBOUNDED)
CONFIG = load_section("close_loop", CloseLoopConfig, "paper").diagnosis


def driven(seed: int, minutes: float, activity: float) -> Sequences:
    """Joints without lag that share a supply of two, each held at random for that share of the time."""
    random = np.random.default_rng(seed)
    n_rows = round(60.0 * minutes / DT_S)
    moves = random.random((n_rows // 20, N_JOINT)) < activity
    command = (moves * random.choice([-1.0, 1.0], moves.shape)).repeat(20, axis=0)
    q = np.zeros((n_rows, N_JOINT))
    velocity = np.zeros((n_rows, N_JOINT))
    for row in range(n_rows):
        # away from the stops, which are not in question here
        command[row] = np.where(np.abs(q[row]) > 1.8, -np.sign(q[row]) * np.abs(command[row]), command[row])
        demand = max(np.abs(command[row]).sum() / SUPPLY, 1.0)
        velocity[row] = SPEED * command[row] / demand
        if row + 1 < n_rows:
            q[row + 1] = q[row] + DT_S * velocity[row]
    time_s = DT_S * np.arange(n_rows)
    columns = command, q, velocity, time_s, (1e9 * time_s).astype(np.int64), np.ones(n_rows, bool)
    return Sequences(*(column[None] for column in columns))


@pytest.fixture(scope="module")
def nominal() -> Sequences:
    return driven(0, minutes=20.0, activity=0.25)


@pytest.mark.long
def test_a_shared_supply_is_known_where_more_joints_move_at_once_than_nominal_logs_show(nominal):
    at_once = np.abs(nominal.command[0]).sum(axis=-1)
    assert np.mean(at_once > SUPPLY) < 0.06
    model = train_diagnosis_model(nominal, LOWER, UPPER, DT_S, CONFIG, seed=0, is_switched=True)
    busy = driven(1, minutes=3.0, activity=0.75)
    velocity = np.asarray(model.members_velocity(busy.command, busy.q)).mean(axis=0)
    is_many = np.abs(busy.command).sum(axis=-1) > SUPPLY
    assert is_many.mean() > 0.6
    moving = is_many[..., None] & (busy.command != 0.0)
    error = (velocity - busy.velocity) * np.sign(busy.command) / SPEED
    # a supply that is not shared would be off by a third with three joints, and by half with four
    assert abs(error[moving].mean()) < 0.03
    assert np.sqrt(np.mean(error[moving] ** 2)) < 0.1


def test_rows_with_more_joints_at_once_than_ever_before_are_not_known(nominal):
    at_once = np.abs(nominal.command).sum(axis=-1, keepdims=True)
    few = nominal._replace(command=np.where(at_once <= 2, nominal.command, 0.0))
    busy = driven(1, minutes=3.0, activity=0.75)
    is_many = np.abs(busy.command).sum(axis=-1, keepdims=True) > 2
    known = is_known(few, busy, SCALES, is_switched=True)
    assert not known[is_many & (busy.command != 0.0)].any()
    assert known[~is_many & (np.abs(busy.q) < 1.0)].all()
    # the sum of proportional commands says little of what valves let through
    assert is_known(few, busy, SCALES, is_switched=False)[np.abs(busy.q) < 1.0].all()
