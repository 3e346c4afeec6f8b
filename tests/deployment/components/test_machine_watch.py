"""`machine_watch` in simulated time: bags are replayed, and what it tells is held against the command's answers."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.machine_watch import NAME, MachineWatch
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.messages import JointState, Level, MachineCommand, Status, Topic
from pipeline.deployment.transports.simulated_time.delays import no_delays
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import as_array
from pipeline.watch.look import look
from tests.watch.two_joints import MACHINE, learn, paths, settings, write_session

SILENT_S = 3.0  # after the last message
LIVE_S = 60.0  # `watch.live_every_s`


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with ten nominal sessions, and a state with two more."""
    root = tmp_path_factory.mktemp("watch")
    learn(root)
    for day in (11, 12):
        write_session(root / "sessions", day)
    look(paths(root), settings())
    return root


def replayed(bag: Path, state: Path, seconds: float = np.inf) -> tuple[MachineWatch, Recorder]:
    """A component that has heard a bag's messages as they were recorded, and what was said meanwhile."""
    (entry,) = find_logs(bag)
    raw = read_log(entry, MACHINE)
    joint = zip(*map(as_array, (raw.joint_log_time_ns, raw.joint_stamp_ns, raw.q)), strict=True)
    command = zip(*map(as_array, (raw.command_log_time_ns, raw.command)), strict=True)
    heard = [(int(t), Topic.joint_states, JointState(int(s), q, 0 * q)) for t, s, q in joint]
    heard += [(int(t), Topic.joint_commands, MachineCommand(int(t), a)) for t, a in command]
    heard = [one for one in sorted(heard, key=lambda one: one[0]) if one[0] < heard[0][0] + 1e9 * seconds]
    watch, recorder = MachineWatch(state, settings()), Recorder()
    begin_ns = heard[0][0]
    graph = SimulatedGraph([watch], no_delays(), np.random.SeedSequence(0), begin_ns, taps=[recorder])
    for time_ns, topic, message in heard:
        graph.run(time_ns)
        graph.send(topic, message)
    graph.run(graph.time_ns + nanoseconds(SILENT_S))
    return watch, recorder


def told(recorder: Recorder) -> list[Status]:
    return [status for said in recorder.diagnostics for status in said.statuses]


def copied(root: Path, folder: Path) -> Path:
    """The same once more, for one test to go on with."""
    for name in ("state", "sessions"):
        shutil.copytree(root / name, folder / name)
    (folder / "nominal").symlink_to(root / "nominal")
    return folder


def content_of(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def of_bag(document: dict, bag: Path) -> dict:
    """With the bag's name in place of the running session's, and without causes, which the command alone seeks."""
    findings = [{key: of[key] for key in of if key != "cause"} for of in document["findings"]]
    text = str([document["state"], document["e_value"], document["sessions"], findings])
    return {"said": text.replace(repr(NAME), repr(bag.name))}


@pytest.mark.parametrize("slower", [1.0, 0.5])
def test_a_replayed_session_ends_with_the_commands_answers(root: Path, tmp_path: Path, slower: float) -> None:
    bag = write_session(tmp_path / "new", 13, slower)
    before = content_of(root / "state")
    watch, recorder = replayed(bag, root / "state")
    assert content_of(root / "state") == before
    shutil.copytree(bag, copied(root, tmp_path) / "sessions" / bag.name)
    document = look(paths(tmp_path), settings())
    assert of_bag(watch.standing.document, bag) == of_bag(document, bag)
    last = told(recorder)[-1]
    evidence = document["sessions"][-1]["joints"]["turn"]["e_value"]
    assert last.values["turn"] == f"healthy, evidence {evidence:.3g}, moved 8.0 of 8 s"
    assert last.text == f"healthy, evidence {document['e_value']:.3g} of 20"
    assert last.level is Level.ok  # no single session alarms
    assert (evidence > 1.2) == (slower < 1.0)


def test_progress_is_told_until_there_is_enough_and_nothing_is_commanded(root: Path, tmp_path: Path) -> None:
    bag = write_session(tmp_path / "new", 14)
    _, recorder = replayed(bag, root / "state")
    said = told(recorder)
    assert {status.source for status in said} == {"machine_watch"}
    assert said[0].text.startswith("unestimated, ") and said[0].text.endswith(f" of {LIVE_S:.0f} s of motion")
    assert said[0].values["turn"] == "moved 0.0 of 8 s"
    states = [status.text.split(",")[0] for status in said]
    first = states.index("healthy")
    assert set(states[:first]) == {"unestimated"} and set(states[first:]) == {"healthy"}
    assert LIVE_S <= first <= len(said) - 2 * SILENT_S  # not at the end alone
    assert not recorder.requests and len(recorder.commands) == len(recorder.states)  # the bag's own


def test_a_changed_machine_is_a_warning(root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.watch.look.cause_of", lambda *_: None)  # takes minutes
    sessions = copied(root, tmp_path) / "sessions"
    for day in (13, 14):
        write_session(sessions, day, 0.5)
    look(paths(tmp_path), settings())
    bag = write_session(tmp_path / "new", 15, 0.5)
    watch, recorder = replayed(bag, tmp_path / "state")
    last = told(recorder)[-1]
    assert last.text.startswith("changed, evidence ") and last.level is Level.warning
    assert last.values["turn"].startswith("changed, ") and last.values["lift"].startswith("healthy, ")
    bag.rename(tmp_path / "sessions" / bag.name)
    assert of_bag(watch.standing.document, bag) == of_bag(look(paths(tmp_path), settings()), bag)


def test_what_cannot_be_judged_is_a_warning_with_the_reason(root: Path, tmp_path: Path) -> None:
    bag = write_session(tmp_path / "new", 15)
    _, recorder = replayed(bag, root / "state", seconds=0.5)
    last = told(recorder)[-1]
    assert last.text.startswith("unestimated: ") and "no trajectory" in last.text
    assert last.level is Level.warning


def test_a_folder_without_a_state_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="run `watch` with this state first"):
        MachineWatch(tmp_path, settings())
