"""Causes through measured channels: which channel the search names, and which it leaves alone."""

from collections.abc import Callable

import numpy as np
import pytest

from pipeline.configuration.load import load_section
from pipeline.discrepancy.diagnosis.channels import channels_of
from pipeline.discrepancy.diagnosis.scored_rows import rows_in_blocks
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.selection.grouping import depends_on, effects_of
from pipeline.discrepancy.selection.search import Search
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.machine.log_sources import ChannelSource
from pipeline.machine.specification import JointSpecification, MachineSpecification
from tests.discrepancy.exact_machine import DT_S, N_JOINT, SPEED, held_commands, simulation_of

N_ROWS, NOISE = 9600, 0.02  # eight minutes
NAMES = ("oil", "rpm", "pressure", "idle", "lost")
MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -1.0, 1.0)],
    channels=[ChannelSource(name, column=name) for name in NAMES],
)
FAMILIES = ["gain", "flow_coupling", "thermal_drift", "other:velocity", "other:activity", "other:channel"]
BOTH = np.ones(2)


def wandering(random: np.random.Generator, time_s: float) -> np.ndarray:
    """(T,) a process of first order, of a standard deviation of about one."""
    kept = np.exp(-DT_S / time_s)
    x = np.sqrt(1.0 - kept**2) * random.standard_normal(N_ROWS)
    for row in range(1, N_ROWS):
        x[row] += kept * x[row - 1]
    return x


def channels(seed: int, command: np.ndarray) -> dict[str, np.ndarray]:
    """Oil that warms up twice, an engine that hunts, a pressure that follows both and the commands."""
    random = np.random.default_rng(seed)
    since_s = DT_S * (np.arange(N_ROWS) % (N_ROWS // 2))
    rpm = 2000.0 + 160.0 * wandering(random, 6.0)
    load = np.abs(command).sum(axis=1)
    return {
        "oil": 45.0 - 25.0 * np.exp(-since_s / 100.0) + 0.2 * random.standard_normal(N_ROWS),
        "rpm": rpm,
        "pressure": 100.0 + 0.02 * rpm * load + 2.0 * random.standard_normal(N_ROWS),
        "idle": np.full(N_ROWS, 7.0),
        "lost": np.full(N_ROWS, np.nan),
    }


def told(ratio: Callable[[dict[str, np.ndarray], np.ndarray], np.ndarray], seed: int = 1) -> list:
    """Family, joints and variables of what the search finds; the ratio of speeds is (T, 2) of channels and commands."""
    command = held_commands(seed, N_ROWS)
    x = channels(seed, command)
    noise = NOISE * np.random.default_rng(seed + 1).standard_normal(command.shape)
    velocity = SPEED * command * ratio(x, command) + noise
    simulation = simulation_of(FAMILIES, command, velocity, x)
    fold = (np.arange(N_ROWS) // 400 % 2)[None]
    every, floor = np.ones((1, N_ROWS, N_JOINT), bool), np.full(N_JOINT, NOISE**2 / 2)
    rows = rows_in_blocks(np.ones((1, N_ROWS), bool), fold, every, floor, 200)
    settings = load_section("close_loop", CloseLoopConfig, "paper").search
    found = Search(simulation, rows, {}, settings, (), {}, MACHINE.joint_names, (0, 1), lambda _: None).run()
    return [(e.family, e.joints, depends_on(e, MACHINE)) for e in effects_of(found, (0, 1))]


@pytest.mark.parametrize("joints", [[0, 1], [1]])
def test_the_channel_that_carries_the_cause_is_named(joints: list[int]) -> None:
    own = np.isin([0, 1], joints)
    effects = told(lambda x, _: 1.0 + own * 1.2 * (x["rpm"][:, None] / 2000.0 - 1.0))
    assert effects == [("other", joints, ["channel:rpm"])]


def test_a_channel_that_has_no_part_in_a_change_is_not_named() -> None:
    assert told(lambda x, _: np.array([1.0, 0.7]) * BOTH) == [("gain", [1], ["command:turn"])]


def test_what_a_log_lacks_or_never_changes_is_not_looked_at() -> None:
    command = held_commands(1, N_ROWS)
    x = channels(1, command)
    nothing = np.zeros((1, N_ROWS))
    of = np.stack(list(x.values()), axis=-1)[None]
    rows = Sequences(nothing, nothing, nothing, nothing, nothing, np.ones((1, N_ROWS), bool), of)
    found = channels_of(rows, rows, NAMES, DT_S)
    assert [c.name for c in found if c.upper > c.lower] == ["oil", "rpm", "pressure"]
    oil, rpm, *_ = found
    assert oil.lower < 23.0 < 41.0 < oil.upper and rpm.usual == pytest.approx(2000.0, abs=50.0)
    assert rpm.kept == pytest.approx(np.exp(-1.0 / 6.0), abs=0.05) and oil.kept > 0.97
    constant = rows._replace(channels=of[..., 3:])
    assert channels_of(constant, constant, NAMES[3:], DT_S) == ()
