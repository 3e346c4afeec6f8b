"""A machine with proportional commands, simulated here, and what a controller before its valves does to it."""

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis, diagnose
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.diagnosis.prepare import prepare
from pipeline.discrepancy.diagnosis.simulation import NOMINAL
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.grouping import depends_on, effects_of
from pipeline.discrepancy.selection.screen import screen
from pipeline.discrepancy.selection.select import Selection, select
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.effects.catalogue import known_for
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import CommandKind, JointSpecification, MachineSpecification

pytestmark = [pytest.mark.slow, pytest.mark.long]

MACHINE = MachineSpecification(
    name="two_valves",
    rate_hz=20.0,
    command_kind=CommandKind.continuous,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -2.0, 2.0)],
)
DT_S = 0.05
SPEEDS, CONSTANTS_S = np.array([0.4, 0.6]), np.array([0.2, 0.3])
OWN_BAND = 0.1  # of the valves themselves
DRAWN = 0.4  # of the first joint's speed, by the second at full command


def record(
    name: str, seed: int, n_rows: int, band: float = 0.0, late_rows: tuple[int, int] = (0, 0)
) -> Trajectory:
    """Random holds of proportional commands; a further dead band on the second joint, each late by so many rows."""
    random = np.random.default_rng(seed)
    a, q, velocity = np.zeros((n_rows, 2)), np.zeros((n_rows, 2)), np.zeros(2)
    command, left = np.zeros(2), np.zeros(2)
    for row in range(n_rows - 1):
        for joint in range(2):
            left[joint] -= 1
            if left[joint] <= 0:
                command[joint] = random.choice([0.0, *random.uniform(-1.0, 1.0, 3)])
                left[joint] = random.integers(4, 40)
            if abs(q[row, joint]) > 0.8 * (1.0, 2.0)[joint]:
                command[joint] = -np.sign(q[row, joint]) * abs(command[joint])
        a[row] = command
        reaching = np.array([a[max(row - late, 0), joint] for joint, late in enumerate(late_rows)])
        for width, joints in ((band, [1]), (OWN_BAND, [0, 1])):
            left_over = np.maximum(np.abs(reaching[joints]) - width, 0.0) / (1.0 - width)
            reaching = reaching.copy()
            reaching[joints] = np.sign(reaching[joints]) * left_over
        target = SPEEDS * reaching * (1.0 - DRAWN * np.array([abs(reaching[1]), 0.0]))
        velocity = velocity + (1.0 - np.exp(-DT_S / CONSTANTS_S)) * (target - velocity)
        q[row + 1] = q[row] + DT_S * velocity
    q = q + 5e-4 * random.standard_normal(q.shape)
    t_s = DT_S * np.arange(n_rows)
    stamp_ns = (1_000_000_000 * (1000 * seed + t_s)).astype(np.int64)
    return Trajectory(
        name, t_s, stamp_ns, q, np.gradient(q, DT_S, axis=0), a, np.arange(n_rows) >= 0.9 * n_rows
    )


@pytest.fixture(scope="module")
def nominal() -> list[Trajectory]:
    """Two logs of the machine as it was."""
    return [record("nominal_1", 1, 5000), record("nominal_2", 2, 5000)]


def settings() -> tuple[CloseLoopConfig, IdentifyConfig]:
    """As by default."""
    return load_section("close_loop", CloseLoopConfig, "paper"), load_section(
        "identify", IdentifyConfig, "paper"
    )


@pytest.fixture(scope="module")
def usual(nominal: list[Trajectory]) -> NominalBehaviour:
    """What the nominal logs say."""
    return learn_nominal_behaviour(nominal, MACHINE, *settings())


def searched(usual: NominalBehaviour, measured: list[Trajectory]) -> tuple[Diagnosis, Selection]:
    """The steps up to the search."""
    journal = Journal()
    diagnosis = diagnose(prepare([], measured, MACHINE, *settings()), usual, None, journal)
    return diagnosis, select(diagnosis, journal)


def test_a_dead_band_and_a_late_channel_are_told_apart(usual: NominalBehaviour) -> None:
    logs = [record(f"measured_{seed}", seed, 4000, band=0.35, late_rows=(3, 3)) for seed in (11, 12)]
    diagnosis, selection = searched(usual, logs)
    effects = {effect.family: effect for effect in effects_of(selection.found, diagnosis.excited)}
    assert set(effects) == {"other", "timing"}
    (member,) = effects["other"].members
    assert depends_on(effects["other"], diagnosis.logs.machine) == ["command:turn"]
    first = next(c for c in selection.screened if c.key == member.candidate.key)
    assert first.owed < 0.1 * first.gain
    assert member.candidate.point["dead_band_positive"] == pytest.approx(0.35, abs=0.06)
    assert member.candidate.point["dead_band_negative"] == pytest.approx(0.35, abs=0.06)
    for delay in effects["timing"].members:
        assert delay.candidate.point["added_delay"] == pytest.approx(3 * DT_S, abs=0.02)


def test_one_late_joint_is_no_late_channel_and_its_dead_band_no_effect_on_the_other(
    usual: NominalBehaviour,
) -> None:
    logs = [record(f"measured_{seed}", seed, 4000, band=0.35, late_rows=(0, 4)) for seed in (13, 14)]
    diagnosis, selection = searched(usual, logs)
    joints = diagnosis.logs.joints
    found = {(f.candidate.family, joints[f.candidate.joint]): f.candidate for f in selection.found}
    assert set(found) == {("other:dead_band", "turn"), ("delay", "turn")}
    assert found["delay", "turn"].point["added_delay"] == pytest.approx(4 * DT_S, abs=0.03)


def test_nothing_is_found_where_nothing_changed_and_on_nominal_logs_all_is_misfit(
    usual: NominalBehaviour,
) -> None:
    _, selection = searched(usual, [record(f"measured_{seed}", seed, 4000) for seed in (15, 16)])
    assert selection.found == []
    again = screen(usual.simulation, NOMINAL, usual.rows, nominal=usual.null)
    known = [candidate for candidate in again if candidate.key in usual.null]
    assert known
    for candidate in known:
        assert candidate.owed >= candidate.gain * (1.0 - 1e-6), candidate.key


def test_discrete_commands_are_not_searched_for_a_dead_band() -> None:
    assert set(known_for(CommandKind.continuous)) - set(known_for(CommandKind.discrete)) == {
        "other:dead_band"
    }
