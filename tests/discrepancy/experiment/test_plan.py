"""Plans as files, and the player that follows them on a machine of a few lines."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.experiment.plan import Plan, Separation, Step, read_plan
from pipeline.discrepancy.experiment.player import PlanPlayer
from pipeline.errors import InputError
from pipeline.machine.specification import JointSpecification, MachineSpecification
from pipeline.machine.workspace import EnvelopeConfig

MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -1.0, 1.0)],
)
HELD = [
    Step(command={"lift": 1.0}, seconds=0.5),
    Step(seconds=0.3),
    Step(command={"lift": -1.0}, seconds=0.5),
]
PLAN = Plan(
    "two_joints",
    [Step(goal={"lift": 0.4, "turn": -0.3}), *HELD],
    [Separation(("delay (lift)", "lag (lift)"), 7.5), Separation(("lag (lift)", "delay (lift)"), 4.0)],
    ["supply_variation (lift)"],
    EnvelopeConfig(0.1, 0.0, {"lift": [-0.8, 0.8]}),
    speed={"lift": 0.4, "turn": 0.4},
    tolerance={"lift": 0.03, "turn": 0.03},
    rest_s=0.5,
    stopping_s=0.3,
    motion_s=1.0,
    duration_s=4.0,
)


def test_a_plan_is_read_as_it_was_written(tmp_path: Path) -> None:
    PLAN.write(tmp_path / "plan.json")
    assert read_plan(tmp_path / "plan.json", MACHINE) == PLAN
    assert "98% of the probability" in PLAN.sentence and "lift" in PLAN.sentence


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lambda content: content.update(machine="other"), "is of machine other, not of two_joints"),
        (lambda content: content["steps"][1].update(command={"lift": 2.0}), "no step of two_joints"),
        (lambda content: content["steps"][1].update(command={"hand": 1.0}), "no step of two_joints"),
        (lambda content: content["steps"][1].update(seconds=-1.0), "no step of two_joints"),
        (lambda content: content.pop("speed"), "not a plan .*speed"),
        (lambda content: content.update(steps=[]), "not a plan"),
    ],
)
def test_what_is_no_plan_is_refused_in_one_line(
    tmp_path: Path, change: Callable[[dict[str, Any]], Any], fault: str
) -> None:
    path = tmp_path / "plan.json"
    PLAN.write(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=fault):
        read_plan(path, MACHINE)
    with pytest.raises(InputError, match="name the experiment"):
        read_plan(tmp_path / "nowhere.json", MACHINE)


def played(start: list[float], speed: float = 0.4) -> tuple[np.ndarray, np.ndarray]:
    """Positions and commands on joints that follow their commands with a time constant of 0.1 s."""
    player, q, v = PlanPlayer(MACHINE, PLAN), np.array(start), np.zeros(2)
    visited, commands = [], []
    for _ in range(2000):
        command = player.command(q)
        if player.is_done:
            break
        visited.append(q)
        commands.append(command)
        v = v + 0.4 * (speed * command - v)
        q = q + 0.05 * v
    return np.array(visited), np.array(commands)


@pytest.mark.parametrize("start", [[0.0, 0.0], [0.9, -0.9], [0.4, -0.3]])
def test_the_player_aims_first_and_then_holds_by_the_clock(start: list[float]) -> None:
    visited, commands = played(start)
    held = np.repeat([[1.0, 0.0], [0.0, 0.0], [-1.0, 0.0]], [10, 6, 10], axis=0)
    assert np.array_equal(commands[-len(held) :], held)
    aimed = visited[len(visited) - len(held)]
    assert np.all(np.abs(aimed - [0.4, -0.3]) <= 0.03)
    assert set(np.unique(commands)) <= {-1.0, 0.0, 1.0}


def test_a_machine_that_does_not_come_near_is_not_waited_for_for_ever() -> None:
    visited, commands = played([-0.5, -0.3], speed=0.0)
    assert len(visited) < 400 and not commands[:, 1][:100].any()
