"""A machine with proportional commands, simulated here, and what a controller before its valves does to it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.configuration import load_section
from pipeline.discrepancy.close_loop import Loop
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.verdict import depends_on, effects_of
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import CommandKind, JointSpecification, MachineSpecification

pytestmark = pytest.mark.slow

MACHINE = MachineSpecification(
    name="two_valves",
    rate_hz=20.0,
    command_kind=CommandKind.continuous,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -2.0, 2.0)],
)
DT_S = 0.05
SPEEDS, CONSTANTS_S = np.array([0.4, 0.6]), np.array([0.2, 0.3])
OWN_BAND = 0.1  # of the valves themselves


def record(name: str, seed: int, n_rows: int, band: float = 0.0, late_rows: int = 0) -> Trajectory:
    """Random holds of proportional commands; a further dead band on the second joint, both late by so many rows."""
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
        reaching = a[row - late_rows] if row >= late_rows else np.zeros(2)
        for width, joints in ((band, [1]), (OWN_BAND, [0, 1])):
            left_over = np.maximum(np.abs(reaching[joints]) - width, 0.0) / (1.0 - width)
            reaching = reaching.copy()
            reaching[joints] = np.sign(reaching[joints]) * left_over
        velocity = velocity + (1.0 - np.exp(-DT_S / CONSTANTS_S)) * (SPEEDS * reaching - velocity)
        q[row + 1] = q[row] + DT_S * velocity
    q = q + 5e-4 * random.standard_normal(q.shape)
    t_s = DT_S * np.arange(n_rows)
    stamp_ns = (1_000_000_000 * (1000 * seed + t_s)).astype(np.int64)
    return Trajectory(
        name, t_s, stamp_ns, q, np.gradient(q, DT_S, axis=0), a, np.arange(n_rows) >= 0.9 * n_rows
    )


def searched(measured: list[Trajectory]) -> Loop:
    """The loop up to its search, on a smaller budget."""
    config = load_section("close_loop", CloseLoopConfig, "paper")
    config = replace(config, diagnosis=replace(config.diagnosis, updates=800))
    nominal = [record("nominal_1", 1, 5000), record("nominal_2", 2, 5000)]
    loop = Loop(nominal, measured, MACHINE, None, None, config, lambda _: None)
    loop._diagnose()
    loop._search()
    return loop


def test_a_dead_band_and_a_late_channel_are_told_apart() -> None:
    logs = [record(f"measured_{seed}", seed, 4000, band=0.35, late_rows=3) for seed in (11, 12)]
    loop = searched(logs)
    effects = {effect.family: effect for effect in effects_of(loop.search.found, loop.excited)}
    assert set(effects) == {"other", "timing"}
    (member,) = effects["other"].members
    assert depends_on(effects["other"], loop.joints) == ["command:turn"]
    assert member.candidate.point["dead_band_positive"] == pytest.approx(0.35, abs=0.06)
    assert member.candidate.point["dead_band_negative"] == pytest.approx(0.35, abs=0.06)
    for delay in effects["timing"].members:
        assert delay.candidate.point["added_delay"] == pytest.approx(3 * DT_S, abs=0.02)


def test_discrete_commands_are_not_searched_for_a_dead_band() -> None:
    config = load_section("close_loop", CloseLoopConfig, "paper")
    config = replace(config, diagnosis=replace(config.diagnosis, updates=1))
    logs = [record("nominal", 1, 5000), record("measured", 2, 4000)]
    for kind, is_there in ((CommandKind.continuous, True), (CommandKind.discrete, False)):
        machine = replace(MACHINE, command_kind=kind)
        logs = [replace(log, a=np.sign(log.a)) for log in logs] if not is_there else logs
        loop = Loop(logs[:1], logs[1:], machine, None, None, config, lambda _: None)
        loop._diagnose()
        assert ("other:dead_band" in loop.simulation.effects) is is_there
