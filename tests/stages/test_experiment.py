"""Stage `experiment`: a plan is played on the simulated machine, recorded, and stopped where it would leave W+."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine, load_section
from pipeline.discrepancy.experiment.plan import FILE, Plan, Step
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.trajectories import load_logs
from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import load_arm
from pipeline.machine.workspace import Envelope, EnvelopeConfig
from tests.stages.command import run_stage

ROOT = Path(__file__).parents[2]  # the file of delays is named from here
MACHINE = load_machine("bobcat_e10")
JOINTS = MACHINE.joint_names
START = dict(zip(JOINTS, (0.1, 0.9, -1.6, -0.7), strict=True))  # in W+
ENVELOPE = EnvelopeConfig(0.0, 0.0, {})


def plan_of(*steps: Step) -> Plan:
    speed, near = dict.fromkeys(JOINTS, 0.4), dict.fromkeys(JOINTS, 0.1)
    return Plan(
        MACHINE.name, [Step(goal=START), *steps], [], [], ENVELOPE, speed, near, 1.0, 0.37, duration_s=12.0
    )


def recorded(folder: Path, plan: Plan, *overrides: str) -> tuple[Trajectory, str]:
    plan.write(folder / FILE)
    output = folder / "new"
    done = run_stage("experiment", f"plan={folder / FILE}", f"output={output}", *overrides, folder=ROOT)
    assert done.returncode == 0, done.stderr
    sections = load_section("ingest", IngestConfig), load_section("control.loop_tracker", LoopTrackerConfig)
    (log,) = load_logs(output / "logs", MACHINE, *sections)
    (rows,) = log.trajectories
    return rows, done.stdout


def test_a_plan_is_played_by_the_clock_and_read_as_any_log(tmp_path: Path) -> None:
    held = [
        Step(command={"swing": 1.0}, seconds=1.0),
        Step(seconds=1.0),
        Step(command={"swing": -1.0}, seconds=1.0),
    ]
    rows, said = recorded(tmp_path, plan_of(*held))
    assert "stopped the machine" not in said
    swing = rows.a[:, 0]
    assert [int((swing == sign).sum()) for sign in (1, -1)] == pytest.approx([20, 20], abs=1)
    assert not rows.a[:, 1:].any()
    assert np.ptp(rows.q[:, 0]) > 0.1


def test_the_supervisor_holds_the_envelope_against_the_plan(tmp_path: Path) -> None:
    rows, said = recorded(
        tmp_path, plan_of(Step(command={"swing": 1.0}, seconds=8.0)), "deployment.supervisor.rules=[]"
    )
    assert "stopped the machine by envelope" in said
    region = Envelope(MACHINE, load_arm(MACHINE, MACHINE_DIRECTORY), ENVELOPE)
    assert rows.q[:, 0].max() > 0.6 and region.holds_each(rows.q).all()


def test_what_is_no_plan_is_told_in_one_line(tmp_path: Path) -> None:
    done = run_stage("experiment", f"plan={tmp_path / FILE}", f"output={tmp_path}", folder=ROOT)
    assert done.returncode == 2 and "experiment.json: No such file" in done.stderr
