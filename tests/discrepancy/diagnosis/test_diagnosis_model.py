"""The diagnosis model against a machine in closed form, driven as its nominal logs hardly show."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.diagnosis_model import train_diagnosis_model
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.training_support import is_known
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.effects.effect import Setting
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import JointSpecification, MachineSpecification

ROWS = ("t_s", "stamp_ns", "q", "qd", "a", "is_validation")
N_JOINT, DT_S, SUPPLY = 4, 0.05, 2.0
SPEED = np.array([0.5, 0.4, 0.6, 0.7])
LOWER, UPPER = -2.0 * np.ones(N_JOINT), 2.0 * np.ones(N_JOINT)
MACHINE = MachineSpecification(
    "four_joints", 1.0 / DT_S, [JointSpecification(f"joint_{j}", -2.0, 2.0) for j in range(N_JOINT)]
)


def driven(seed: int, minutes: float, activity: float) -> Trajectory:
    """Joints without lag that share a supply of two, each held at random for that share of the time."""
    random = np.random.default_rng(seed)
    n_rows = round(60.0 * minutes / DT_S)
    moves = random.random((n_rows // 20, N_JOINT)) < activity
    command = (moves * random.choice([-1.0, 1.0], moves.shape)).repeat(20, axis=0)
    q = np.zeros((n_rows, N_JOINT))
    for row in range(n_rows):
        # away from the stops, which are not in question here
        command[row] = np.where(np.abs(q[row]) > 1.8, -np.sign(q[row]) * np.abs(command[row]), command[row])
        demand = max(np.abs(command[row]).sum() / SUPPLY, 1.0)
        if row + 1 < n_rows:
            q[row + 1] = q[row] + DT_S * SPEED * command[row] / demand
    t_s = DT_S * np.arange(n_rows)
    velocity = np.gradient(q, DT_S, axis=0)
    is_validation = np.arange(n_rows) >= 0.9 * n_rows
    return Trajectory("driven", t_s, (1e9 * t_s).astype(np.int64), q, velocity, command, is_validation)


def rows_of(trajectory: Trajectory) -> Sequences:
    return side_by_side([trajectory], DT_S, 24)


@pytest.fixture(scope="module")
def nominal() -> Trajectory:
    return driven(0, minutes=20.0, activity=0.25)


@pytest.mark.long
def test_a_shared_supply_is_known_where_more_joints_move_at_once_than_nominal_logs_show(nominal):
    at_once = np.abs(nominal.a).sum(axis=-1)
    assert np.mean(at_once > SUPPLY) < 0.06
    identify = load_section("identify", IdentifyConfig, "paper")
    busy = rows_of(driven(1, minutes=3.0, activity=0.75))
    model = train_diagnosis_model([nominal], rows_of(nominal).q.shape[1], MACHINE, identify, seed=0)
    velocity = np.asarray(model.velocity(busy.command, busy.q))
    is_many = busy.is_row & (np.abs(busy.command).sum(axis=-1) > SUPPLY)
    assert is_many.sum() > 0.6 * busy.is_row.sum()
    moving = is_many[..., None] & (busy.command != 0.0)
    error = (velocity - busy.velocity) * np.sign(busy.command) / SPEED
    # a supply that is not shared would be off by a third with three joints, and by half with four
    assert abs(error[moving].mean()) < 0.03
    assert np.sqrt(np.mean(error[moving] ** 2)) < 0.1


def test_rows_with_more_joints_at_once_than_ever_before_are_not_known(nominal):
    nominal = rows_of(nominal)
    at_once = np.abs(nominal.command).sum(axis=-1, keepdims=True)
    few = nominal._replace(command=np.where(at_once <= 2, nominal.command, 0.0))
    busy = rows_of(driven(1, minutes=3.0, activity=0.75))
    is_many = np.abs(busy.command).sum(axis=-1, keepdims=True) > 2
    setting = Setting(DT_S, LOWER, UPPER, SPEED)
    known = is_known(few, busy, setting, is_switched=True)
    assert not known[is_many & (busy.command != 0.0)].any()
    assert known[~is_many & (np.abs(busy.q) < 1.0)].all()
    # the sum of proportional commands says little of what valves let through
    assert is_known(few, busy, setting, is_switched=False)[np.abs(busy.q) < 1.0].all()


def test_nominal_logs_that_do_not_suffice_are_told_as_such(nominal):
    short = replace(nominal, **{name: getattr(nominal, name)[:40] for name in ROWS})
    with pytest.raises(UnusableLogs, match="training rows"):
        train_diagnosis_model([short], 1024, MACHINE, load_section("identify", IdentifyConfig), seed=0)
