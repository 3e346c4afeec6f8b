"""The graph as ROS 1 nodes, each a process: a trial at 20 Hz over the machine's CAN drivers, and an emergency.

Where no bus joins processes the simulation's driver takes the drivers' place, and what is said of them is skipped.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.deployment.messages import InterfaceRule
from tests.deployment.ros_node import CAN, GOAL_TICKS, NODES, config
from tests.ros_graph import DIST_PACKAGES, ROSMASTER, requires_debian

PACKAGES = {
    "python3-rosmaster": Path(ROSMASTER),
    "python3-rospy": DIST_PACKAGES / "rospy",
    "python3-actionlib": DIST_PACKAGES / "actionlib",
    "python3-sensor-msgs": DIST_PACKAGES / "sensor_msgs",
}
pytestmark = [pytest.mark.long, requires_debian(PACKAGES)]
TIMEOUT_S = 300


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("graph")
    command = [sys.executable, "-m", "tests.deployment.ros_trial", str(folder)]
    done = subprocess.run(
        command, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=TIMEOUT_S
    )
    printed = "".join(f"\n--- {log.name}\n{log.read_text()[-1500:]}" for log in folder.glob("*.log"))
    assert done.returncode == 0, done.stderr[-3000:] + printed
    unsaved = [name for name in NODES if not (folder / f"{name}.json").exists()]
    assert not unsaved, f"ended without a word of what was measured: {unsaved}" + printed
    return folder


@pytest.fixture(scope="module")
def trial(folder: Path) -> dict:
    return json.loads((folder / "trial.json").read_text())


def test_goals_end(trial: dict) -> None:
    outcomes = [(result["outcome"], result["goal_id"]) for result in trial["results"]]
    assert outcomes == [("timed_out", 0), ("timed_out", 1), ("stopped", 2), ("stopped", 3), ("timed_out", 7)]
    assert [result["n_ticks"] for result in trial["results"][:2]] == [GOAL_TICKS, GOAL_TICKS]
    assert 0 < trial["results"][2]["n_ticks"] < GOAL_TICKS and trial["results"][3]["n_ticks"] == 0


def test_any_actionlib_client_can_give_replace_and_cancel_goals(trial: dict) -> None:
    assert trial["early"] == {"replaced": "cancelled", "cancelled": "cancelled", "refused": "refused"}
    distance_m, pitch_rad = np.array(trial["feedback"]).T
    assert len(distance_m) > 5 and distance_m.min() > 0.1 and distance_m.max() < 3.0
    assert np.ptp(distance_m) > 0 and np.abs(pitch_rad).max() <= np.pi


def test_commands_leave_at_the_control_frequency_and_move_the_machine(trial: dict) -> None:
    stop_s = trial["stops"][0]["s"]
    sent_s = np.array(trial["command_s"])
    gaps_s = np.diff(sent_s[sent_s < stop_s])
    assert len(gaps_s) > 2 * GOAL_TICKS
    assert np.median(gaps_s) == pytest.approx(load_machine("bobcat_e10").dt_s, rel=0.1)
    assert np.ptp(np.array(trial["position"]), axis=0).min() > 0.05


def first_stop(trial: dict) -> dict:
    """Supervisor and interface both refuse the command, each by its rule; on a busy computer one may say so twice."""
    rules = [stop["rule"] for stop in trial["stops"]]
    assert rules and set(rules) <= {"command_value", InterfaceRule.invalid_command}, rules
    return trial["stops"][0]


def test_an_emergency_mutes_every_later_command(trial: dict) -> None:
    stop = first_stop(trial)
    sent_s, moves = np.array(trial["command_s"]), np.array(trial["moves"])
    muted = int(np.argmax(sent_s > trial["rogue_from_s"]))  # the stopped goal's result has come by then
    released = int(np.searchsorted(sent_s, trial["released_s"]))
    last_move_s = sent_s[np.flatnonzero(moves[:released])[-1]]
    assert last_move_s < trial["rogue_from_s"]
    # the server's last zero command ends the goal; from then on the interface alone speaks
    assert last_move_s - stop["s"] < 0.5
    assert len(moves[muted:released]) > 10 and not moves[muted:released].any()


def test_the_plc_zeroes_its_outputs_and_stays_so(trial: dict) -> None:
    if tuple(trial["drivers"]) != CAN:
        pytest.skip("no multicast between processes here, so no CAN bus")
    stop = first_stop(trial)
    at_s, moves = np.array(trial["outputs"]).T  # told when they change: what they were holds until then
    before = at_s < stop["s"]
    assert moves[before].any()
    # Zero by then already, where a busy computer kept frames back for longer than the PLC waits for them.
    is_moving, zero_s = bool(moves[before][-1]), at_s[~before & (moves == 0)]
    held_s = stop["s"] if not is_moving else zero_s[0] if len(zero_s) else np.inf
    assert held_s - stop["s"] < 0.5
    is_released = at_s > trial["released_s"]
    assert not moves[(at_s > held_s) & ~is_released].any() and moves[is_released].any()


def test_a_reset_waits_for_the_sticks_and_for_no_motion_that_is_left_over(trial: dict) -> None:
    (release_s,) = trial["releases_s"]  # though the stop was acknowledged long before the stick was let go
    assert trial["let_go_s"] + config().supervisor.neutral_s <= release_s <= trial["released_s"]


def test_every_node_says_what_it_measured(folder: Path, trial: dict) -> None:
    server = json.loads((folder / "autonomous_server.json").read_text())
    assert len(server["tick"]) > 2 * GOAL_TICKS
    assert len(server["computation DecisionRequest"]) >= 2 * GOAL_TICKS / 4
    for name in {*trial["drivers"], *NODES} - {"bobcat_e10_driver"}:  # it has no timer
        assert len(json.loads((folder / f"{name}.json").read_text())["timer"]) > GOAL_TICKS
