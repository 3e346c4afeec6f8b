"""An operator's sticks drive the machine through the graph, until an emergency stop: as components, and on ROS 1."""

import contextlib
import dataclasses
import itertools
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.control_interface import ControlInterface
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.components.scripted_joystick import ScriptedJoystick
from pipeline.deployment.components.supervision.control_supervisor import supervise
from pipeline.deployment.components.teleoperation_server import TeleoperationServer
from pipeline.deployment.drivers.bobcat_e10_sim_driver import SimulationDriver
from pipeline.deployment.messages import GoalOutcome, JointState, MachineCommand, ReachResult, Topic
from pipeline.deployment.nodes import Driver
from pipeline.deployment.settings import DeploymentConfig
from pipeline.deployment.transports.simulated_time.delays import no_delays
from pipeline.deployment.transports.simulated_time.faults import Fault
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.errors import InputError
from pipeline.logs.tuples import read_tuples
from pipeline.stages.teleoperate import TeleoperateStage
from pipeline.testbench import teleoperation
from pipeline.testbench.target_run import kept_if_cut_off
from pipeline.testbench.teleoperation import GraphKind, Sticks, kept
from tests.deployment.fault_cases import END_NS, ONSET_NS, Killed
from tests.deployment.machines import MIDDLE, SPEED, Integrator, bobcat, estimator, paper, supervised
from tests.deployment.test_ros_trial import PACKAGES
from tests.ros_graph import requires_debian
from tests.stages.command import run_stage

ROOT = Path(__file__).parents[3]  # the file of delays is named from here
SECONDS = 8
TIMEOUT_S = 400  # most of it until five nodes have imported what they run, beside other work
OBJECTING = [
    "deployment.interface.supervised=false",
    "deployment.supervisor.rules=[command_frequency]",
    "deployment.supervisor.maximum_command_rate_hz=15",
]
REACTION_S = 0.5  # from the stop's stamp until the last component has heard of it, on a busy computer


class Always:
    """Holds the sticks one way."""

    def __init__(self, command: np.ndarray) -> None:
        self._command = command

    def command(self, measured: np.ndarray) -> np.ndarray:
        return self._command


@pytest.mark.parametrize("command", list(itertools.product((-1, 0, 1), repeat=2)), ids=str)
def test_the_interpreter_reads_the_sticks_as_they_were_meant(command: tuple[int, ...]) -> None:
    meant = np.array([*command, *command[::-1]])
    config = paper().teleoperation
    joystick = ScriptedJoystick(bobcat(), config, Always(meant))
    assert joystick.on_timer(0) == ()  # nothing was seen of the machine yet
    joystick.on_message(Topic.joint_states, JointState(0, MIDDLE, 0 * MIDDLE), 0)
    (sticks,) = joystick.on_timer(0)
    server = TeleoperationServer(bobcat(), config)
    server.on_message(sticks.topic, sticks.message, 0)
    np.testing.assert_array_equal(server.command(0), meant)


def run_graph(
    config: DeploymentConfig, machine: Integrator, recorder: Recorder, seconds: float, *faults: Fault
) -> None:
    """Sticks that are held, for so long."""
    components = [
        ScriptedJoystick(bobcat(), config.teleoperation, Always(np.array([1, 0, -1, 0]))),
        TeleoperationServer(bobcat(), config.teleoperation),
        supervise(bobcat(), config, MACHINE_DIRECTORY),
        ControlInterface(bobcat(), config.interface),
        SimulationDriver(machine, bobcat().n_joint, config.driver, estimator()),
    ]
    seed = np.random.SeedSequence(0)
    SimulatedGraph(components, no_delays(), seed, faults=faults, taps=[recorder]).run(nanoseconds(seconds))


@pytest.mark.parametrize("is_stopped", [False, True])
def test_sticks_move_the_machine_until_an_emergency_stop(is_stopped: bool) -> None:
    config, machine, recorder = paper(), Integrator(noise=0.0), Recorder()
    limits = dataclasses.replace(
        config.supervisor, rules=["command_frequency"] if is_stopped else [], maximum_command_rate_hz=10
    )
    run_graph(dataclasses.replace(config, supervisor=limits), machine, recorder, 2.0)
    (time_s,) = (recorder.stops[0].stamp_ns / NANOSECONDS,) if is_stopped else (2.0,)
    assert 0.5 <= time_s <= 0.7 if is_stopped else not recorder.stops
    expected = SPEED * time_s * np.array([1, 0, -1, 0])
    np.testing.assert_allclose(machine.q - MIDDLE, expected, atol=SPEED * 0.2)  # of starting up and reacting
    after = [command.values for time_ns, command in recorder.commands if time_ns > time_s * NANOSECONDS]
    assert not np.any(after) and (not is_stopped or len(after) > 10)
    assert all(request.source == "teleoperation_server" for _, request in recorder.requests)


@pytest.mark.parametrize(
    ("killed", "time_out_s"),
    [
        ("joystick", supervised().teleoperation.maximum_silence_s),
        ("teleoperation_server", supervised().supervisor.maximum_command_gap_s),
        ("control_supervisor", supervised().interface.maximum_supervisor_silence_s),
        ("control_interface", supervised().driver.command_timeout_s),
    ],
)
def test_the_machine_stands_within_a_time_out_of_a_death(killed: str, time_out_s: float) -> None:
    config, recorder = supervised(), Recorder()
    limits = dataclasses.replace(config.supervisor, rules=["command_frequency"])
    changed = dataclasses.replace(config, supervisor=limits)
    run_graph(changed, Integrator(noise=0.0), recorder, END_NS / NANOSECONDS, Killed(killed))
    at_ns, q = zip(*((t, state.position[0]) for t, state in recorder.states), strict=True)
    moved_s = at_ns[np.flatnonzero(np.diff(q))[-1] + 1] / NANOSECONDS
    onset_s, periods_s = ONSET_NS / NANOSECONDS, bobcat().dt_s + config.interface.period_s
    assert onset_s < moved_s <= onset_s + time_out_s + periods_s


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"driver": Driver.can}, "`model` is missing"),
        ({"seconds": 0.0}, "must be positive"),
        ({"joystick": Sticks.device, "graph": GraphKind.simulated_time}, "keep real time"),
    ],
)
def test_what_does_not_go_together_is_refused(keys: dict, said: str) -> None:
    with pytest.raises(InputError, match=said):
        TeleoperateStage(**stage_keys() | keys)


def test_what_was_recorded_outlives_whatever_ends_the_recording(tmp_path: Path) -> None:
    for number, end in enumerate((InputError("a node ended"), KeyboardInterrupt(), ValueError("a mistake"))):
        expected = pytest.raises(type(end), match=str(end)) if str(end) else contextlib.nullcontext()
        with expected, kept(spoken_to(begun_s=10 * number), bobcat(), tmp_path):
            raise end
        assert len(list((tmp_path / "logs").iterdir())) == number + 1
    for bag in (tmp_path / "logs").iterdir():
        assert [topic for topic, _, _ in heard(bag)] == ["/joint_states", "/joint_commands"]


def test_where_nothing_was_recorded_the_cause_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no stick was moved"), kept(Recorder(), bobcat(), tmp_path):
        pass
    with pytest.raises(InputError, match="a node ended"), kept(Recorder(), bobcat(), tmp_path):
        raise InputError("a node ended")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("end", [InputError("a goal did not end"), KeyboardInterrupt()])
def test_goals_that_were_pursued_outlive_one_that_never_ends(end: BaseException, tmp_path: Path) -> None:
    recorder = spoken_to(begun_s=10)
    recorder(Topic.result, ReachResult(12 * NANOSECONDS, 0, GoalOutcome.reached, 200), 12 * NANOSECONDS)
    with pytest.raises(type(end)), kept_if_cut_off(tmp_path, bobcat(), recorder):
        raise end
    assert [result["outcome"] for result in json.loads((tmp_path / "results.json").read_text())] == [
        "reached"
    ]
    (bag,) = (tmp_path / "logs").iterdir()
    assert {"/joint_states", "/joint_commands"} <= {topic for topic, _, _ in heard(bag)}
    with pytest.raises(type(end)), kept_if_cut_off(tmp_path, bobcat(), Recorder()):  # nothing was heard
        raise end
    assert len(list((tmp_path / "logs").iterdir())) == 1


def spoken_to(begun_s: int) -> Recorder:
    """A recorder that has heard a state and a command."""
    recorder, time_ns = Recorder(), begun_s * NANOSECONDS
    recorder(Topic.joint_states, JointState(time_ns, MIDDLE, 0 * MIDDLE), time_ns)
    recorder(Topic.joint_commands, MachineCommand(time_ns, np.array([1, 0, 0, 0])), time_ns + 1)
    return recorder


def stage_keys() -> dict:
    return {
        "driver": Driver.plant,
        "model": "",
        "seconds": 1.0,
        "graph": GraphKind.ros,
        "joystick": Sticks.scripted,
    }


def heard(bag: Path) -> Iterator[tuple[str, float, object]]:
    """Topic, time (s) and content of every message in a bag, by a reader that is not ours."""
    for path in sorted(bag.glob("*.mcap")):
        with path.open("rb") as stream:
            for _, channel, message, content in make_reader(
                stream, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages():
                yield channel.topic, message.log_time / NANOSECONDS, content


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """The stage as a command, on the real graph with the plant; a rule objects once the sticks have been held."""
    folder = tmp_path_factory.mktemp("teleoperation")
    command = [sys.executable, "-m", "pipeline.stages.teleoperate", f"output={folder}", f"seconds={SECONDS}"]
    done = subprocess.run(
        [*command, *OBJECTING],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    printed = "".join(f"\n--- {log.name}\n{log.read_text()[-1500:]}" for log in folder.glob("nodes/*.log"))
    assert done.returncode == 0, done.stderr[-3000:] + printed
    assert "stopped the machine by command_frequency" in done.stdout
    return folder


@pytest.mark.long
@requires_debian(PACKAGES)
def test_on_the_ros_graph_commands_reach_the_machine_and_an_emergency_mutes_them(recorded: Path) -> None:
    (bag,) = (recorded / "logs").iterdir()
    said = list(heard(bag))
    (stop_s,) = [
        content.stamp.sec + 1e-9 * content.stamp.nanosec for t, _, content in said if t == "/emergency_stop"
    ]
    requests = [(s, content) for topic, s, content in said if topic == "/requested_commands"]
    assert {content.source for _, content in requests} == {"teleoperation_server"}
    # how many a busy computer lets through in real time is not the question here
    assert sum(s < stop_s for s, _ in requests) >= 5 and not any(s > stop_s + REACTION_S for s, _ in requests)
    commands = [(s, any(content.data)) for topic, s, content in said if topic == "/joint_commands"]
    assert sum(moves for s, moves in commands if s < stop_s) >= 4
    muted = [moves for s, moves in commands if s > stop_s + REACTION_S]
    assert len(muted) > 50 and not any(muted)
    states = [(s, np.array(content.position)) for topic, s, content in said if topic == "/joint_states"]
    after = np.array([q for s, q in states if s > stop_s + 2.0])  # when it has come to rest
    # it moved; how far depends on when a busy computer lets the rule object
    assert len(after) > 50 and np.abs(after[0] - states[0][1]).max() > 0.004
    assert np.ptp(after, axis=0).max() < 0.01


@pytest.mark.long
@requires_debian(PACKAGES)
def test_what_was_recorded_on_the_ros_graph_is_a_log_as_any_other(recorded: Path, tmp_path: Path) -> None:
    result = run_stage("ingest", f"logs={recorded / 'logs'}", f"output={tmp_path}", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    (trajectory,) = read_tuples(tmp_path, bobcat())
    assert len(trajectory.q) > 20 * (SECONDS - 2) and np.any(trajectory.a)


@pytest.mark.long
@pytest.mark.slow
def test_the_same_graph_runs_in_simulated_time_with_the_plant_in_either_condition(tmp_path: Path) -> None:
    ways = []
    for condition in ("workshop", "field"):
        keys = f"output={tmp_path / condition}", f"condition={condition}"
        result = run_stage("teleoperate", *keys, "graph=simulated_time", "seconds=20", folder=ROOT)
        assert result.returncode == 0, result.stderr
        (bag,) = (tmp_path / condition / "logs").iterdir()
        heard_of = [np.array(said.position) for topic, _, said in heard(bag) if topic == "/joint_states"]
        assert np.ptp(heard_of, axis=0).max() > 0.2  # somewhere else in W+
        ways.append(np.ptp(heard_of, axis=0))
    assert not np.allclose(*ways, atol=0.01)


@pytest.mark.slow
def test_who_has_seen_enough_of_simulated_time_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(graph: SimulatedGraph, until_ns: int) -> None:
        graph.run(graph.time_ns + nanoseconds(2.0))
        raise KeyboardInterrupt

    monkeypatch.setattr(teleoperation, "run_at_real_time", interrupted)
    result = run_stage(
        "teleoperate",
        f"output={tmp_path}",
        "graph=simulated_time",
        "seconds=20",
        "live_port=0",
        folder=ROOT,
    )
    assert result.returncode == 0, result.stderr
    (bag,) = (tmp_path / "logs").iterdir()
    assert sum(topic == "/joint_states" for topic, _, _ in heard(bag)) > 50
