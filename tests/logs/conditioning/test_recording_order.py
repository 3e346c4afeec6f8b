"""Messages out of order of time are sorted; a clock that was set back splits the log; what is unclear is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.logs.conditioning import recording_order
from pipeline.logs.conditioning.recording_order import in_order_of_time, steps_of_clock, stretches
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.columns import MemoryStore
from pipeline.logs.messages.raw_log import ChannelSamples, RawLog
from pipeline.logs.trajectories import make_trajectories
from pipeline.machine.specification import ChannelSource
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

SECOND = 1_000_000_000
GAP = SECOND // 2
SECONDS = 20.0


@pytest.fixture(scope="module")
def raw(machine) -> RawLog:
    session = make_session(machine, seconds=SECONDS)
    times = (session.stamp_ns, session.log_time_ns)
    return RawLog("bag", Path("bag"), *times, session.q, session.command_ns, session.command)


@pytest.fixture
def make(machine, config, loop_tracker):
    return lambda raw: make_trajectories(raw, machine, config, loop_tracker)


def stored(raw: RawLog, joints: np.ndarray, commands: np.ndarray) -> RawLog:
    """The log with its messages in another order."""
    return replace(
        raw,
        joint_stamp_ns=raw.joint_stamp_ns[joints],
        joint_log_time_ns=raw.joint_log_time_ns[joints],
        q=raw.q[joints],
        command_log_time_ns=raw.command_log_time_ns[commands],
        command=raw.command[commands],
    )


def by_chunks(raw: RawLog, seconds: float, chunk_order) -> RawLog:
    """The log in chunks of equal time, stored in an order that `chunk_order` makes of their numbers."""
    start = min(raw.joint_log_time_ns[0], raw.command_log_time_ns[0])
    place = np.argsort(chunk_order(np.arange(int(SECONDS / seconds) + 2)))
    orders = [
        np.argsort(place[((times - start) / (seconds * SECOND)).astype(int)], kind="stable")
        for times in (raw.joint_log_time_ns, raw.command_log_time_ns)
    ]
    return stored(raw, *orders)


def set_back(raw: RawLog, at_s: float, by_s: float, with_stamps: bool) -> RawLog:
    """The log of a recorder whose clock is set back."""
    at, by = raw.joint_log_time_ns[0] + int(at_s * SECOND), int(by_s * SECOND)
    later = raw.joint_log_time_ns >= at
    return replace(
        raw,
        joint_log_time_ns=np.where(later, raw.joint_log_time_ns - by, raw.joint_log_time_ns),
        joint_stamp_ns=np.where(later & with_stamps, raw.joint_stamp_ns - by, raw.joint_stamp_ns),
        command_log_time_ns=raw.command_log_time_ns - np.where(raw.command_log_time_ns >= at, by, 0),
    )


def texts(result) -> str:
    return "\n".join(note.text for note in result.notes)


def assert_same_rows(result, expected):
    for one, other in zip(result.trajectories, expected.trajectories, strict=True):
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)
        np.testing.assert_array_equal(one.q, other.q)
        np.testing.assert_array_equal(one.a, other.a)


SHUFFLES = {
    "two chunks swapped": (0.4, lambda chunks: chunks ^ 1),
    "last chunk first": (2.0, lambda chunks: np.argsort(chunks != 9, kind="stable")),
    "backwards": (2.5, lambda chunks: chunks[::-1]),
    "any order": (1.0, lambda chunks: np.random.default_rng(1).permutation(chunks)),
    "any order, short": (0.4, lambda chunks: np.random.default_rng(2).permutation(chunks)),
    "two threads": (1.0, lambda chunks: np.argsort(chunks + 2 * (chunks % 2), kind="stable")),
}


@pytest.mark.parametrize("name", SHUFFLES)
def test_chunks_out_of_order_give_the_rows_of_ordered_ones(raw, make, name):
    seconds, chunk_order = SHUFFLES[name]
    shuffled = by_chunks(raw, seconds, chunk_order)
    assert (np.diff(shuffled.joint_log_time_ns) < -GAP).any()
    result = make(shuffled)
    assert_same_rows(result, make(raw))
    assert "put in order" in texts(result) and "clock steps back" not in texts(result)


@pytest.mark.parametrize("window_s", [0.7, 1.0, 1.3, 1.6, 2.0, 5.0])
def test_messages_out_of_order_within_a_cache(raw, make, window_s):
    rng = np.random.default_rng(0)
    joints, commands = (
        np.lexsort((rng.random(len(times)), ((times - times[0]) / (window_s * SECOND)).astype(int)))
        for times in (raw.joint_log_time_ns, raw.command_log_time_ns)
    )
    result = make(stored(raw, joints, commands))
    assert_same_rows(result, make(raw))
    assert "put in order" in texts(result)


def test_commands_alone_out_of_order(raw, make):
    """Joint samples without a step show that the clock was not set back."""
    everything = np.arange(len(raw.q))
    shuffled = by_chunks(raw, 2.0, lambda chunks: chunks ^ 1)
    commands = np.searchsorted(raw.command_log_time_ns, shuffled.command_log_time_ns)
    result = make(stored(raw, everything, commands))
    assert_same_rows(result, make(raw))
    assert "commands are stored out of order" in texts(result)


@pytest.mark.parametrize("by_s", [0.8, 3.0, 8.0, 3600.0])
def test_clock_that_is_set_back_splits_the_log(raw, make, by_s):
    """Of recorder and publisher on one computer: header stamps step with log time."""
    result = make(set_back(raw, 10.0, by_s, with_stamps=True))
    assert len(result.trajectories) == 2
    assert "the clock steps back; the log is split there" in texts(result)
    assert "put in order" not in texts(result)
    both = [trajectory.q for trajectory in result.trajectories]
    np.testing.assert_array_equal(both[0], make(raw).trajectories[0].q[: len(both[0])])


@pytest.mark.parametrize("by_s", [0.8, 3.0, 3600.0, -0.8, -3.0, -3600.0])
def test_a_clock_of_the_recorder_alone_that_is_set_splits_the_log(raw, make, by_s):
    """Header stamps ascend and commands have log time only: the rows are those of the two halves by log time."""
    by_log_time = replace(raw, joint_stamp_ns=raw.joint_log_time_ns)
    result, expected = (make(set_back(one, 10.0, by_s, with_stamps=False)) for one in (raw, by_log_time))
    assert len(result.trajectories) == 2
    assert_same_rows(result, expected)
    assert f"log time steps {'back' if by_s > 0 else 'forward'} by {abs(by_s):.1f} s" in texts(result)


@pytest.mark.parametrize("by_s", [1.0, 3.0, 3600.0])
@pytest.mark.parametrize("swapped", [[(1, 2)], [(1, 2), (7, 8)], [(6, 8)]])
def test_blocks_out_of_order_and_a_clock_that_is_set_back_are_parted(raw, make, by_s, swapped):
    """The rows are those of the log whose clock is set back alone."""
    chunks = np.arange(22)
    for one, other in swapped:
        chunks[[one, other]] = chunks[[other, one]]
    numbered = replace(raw, q=np.tile(np.arange(len(raw.q))[:, None], (1, raw.q.shape[1])))
    numbered = replace(numbered, command=np.arange(len(raw.command))[:, None])
    shuffled = by_chunks(numbered, 2.0, lambda numbers: chunks[: len(numbers)])
    stepped = set_back(raw, 10.0, by_s, with_stamps=True)
    result = make(stored(stepped, shuffled.q[:, 0], shuffled.command[:, 0]))
    assert_same_rows(result, make(stepped))
    assert "joint samples are stored out of order" in texts(result) and "the log is split there" in texts(
        result
    )


def test_channels_are_put_in_order_too(raw, machine, config, loop_tracker):
    channels = [ChannelSource("oil", "/oil", "data", hold_s=0.5)]
    described = replace(machine, channels=channels)
    at = raw.joint_log_time_ns[::10] + 1
    samples = ChannelSamples(at, np.arange(len(at), dtype=np.float64))
    with_channel = replace(raw, channels={"oil": samples})
    shuffled = by_chunks(with_channel, 2.0, lambda chunks: chunks ^ 1)
    order = np.argsort(((at - raw.joint_log_time_ns[0]) // (2 * SECOND)) ^ 1, kind="stable")
    shuffled = replace(shuffled, channels={"oil": ChannelSamples(at[order], samples.value[order])})
    one, other = (make_trajectories(log, described, config, loop_tracker) for log in (with_channel, shuffled))
    np.testing.assert_array_equal(one.trajectories[0].channels["oil"], other.trajectories[0].channels["oil"])
    assert "samples of channel oil are stored out of order" in texts(other)


def test_what_cannot_be_decided_is_told(raw, make):
    """Behind the step samples are missing: where stretches overlap they are neither as dense as in one nor in two."""
    stepped = set_back(raw, 10.0, 4.0, with_stamps=True)
    row = np.arange(len(raw.q))
    kept = np.flatnonzero((row < 500) | (row > 700) | (row % 5 < 2))
    result = make(stored(stepped, kept, np.arange(len(raw.command))))
    assert "cannot be decided" in texts(result) and "the log is split" in texts(result)


def test_irregular_bursts_do_not_hide_a_clock_that_is_set_back(raw):
    """Samples arrive five at a time, so that most intervals are almost zero."""
    times = raw.joint_log_time_ns.copy()
    times = times[np.arange(len(times)) // 5 * 5] + np.arange(len(times)) % 5 * 1000
    assert not len(stretches(times, None, GAP).back)
    times[500:] -= 5 * SECOND
    is_clock, is_decided = steps_of_clock(times, stretches(times, None, GAP), GAP)
    assert is_clock.tolist() == [True] and is_decided


def test_a_log_shuffled_throughout_tells_that_a_step_of_the_clock_would_not_be_seen(raw, make):
    """Each message of 5 s stands anywhere within them, and from the middle on the clock was set back."""
    stepped, rng = set_back(raw, 10.0, 3.0, True), np.random.default_rng(0)
    joints, commands = (
        np.lexsort((rng.random(n), np.arange(n) // (n // 4))) for n in (len(raw.q), len(raw.command))
    )
    told = texts(make(stored(stepped, joints, commands)))
    assert "out of order throughout; whether the clock was set back too cannot be decided" in told
    assert "joint samples are stored out of order of their log time; put in order" in told


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    swaps=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=4),
    section=st.sampled_from([7, 50, 1 << 15]),
)
def test_sorting_is_numpys_whatever_the_sections(raw, swaps, section):
    chunks = np.arange(22)
    for one, other in swaps:
        chunks[[one, other]] = chunks[[other, one]]
    shuffled = by_chunks(raw, 1.0, lambda numbers: chunks[: len(numbers)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recording_order, "SECTION_ROWS", section)
        patch.setattr("pipeline.logs.messages.columns.SECTION_ROWS", section)
        ordered, _ = in_order_of_time(shuffled, GAP, MemoryStore())
    np.testing.assert_array_equal(ordered.joint_log_time_ns, np.sort(raw.joint_log_time_ns))
    np.testing.assert_array_equal(ordered.q, raw.q[np.argsort(raw.joint_log_time_ns, kind="stable")])


def test_too_far_out_of_order_to_be_sorted_in_bounded_memory(raw, monkeypatch):
    monkeypatch.setattr(recording_order, "SECTION_ROWS", 5)
    monkeypatch.setattr("pipeline.logs.messages.columns.SECTION_ROWS", 5)
    monkeypatch.setattr(recording_order, "MAXIMUM_SORTED_BYTES", 1 << 12)
    order = np.arange(len(raw.q)).reshape(5, -1).T.ravel()
    shuffled = stored(raw, order, np.arange(len(raw.command)))
    ordered, notes = in_order_of_time(shuffled, GAP, MemoryStore())
    np.testing.assert_array_equal(ordered.q, shuffled.q)
    assert "joint samples are stored too far out of order" in notes[0].text


@pytest.mark.parametrize("kind", ["bag", "mcap", "db3"])
def test_files_of_every_format(tmp_path, machine, config, loop_tracker, kind):
    """Messages are written in another order than that of time."""
    store = foreign.ROS1 if kind == "bag" else foreign.ROS2
    entries = foreign.messages(store, make_session(machine, seconds=SECONDS), machine.joint_names)
    start = entries[0][0]
    swapped = sorted(entries, key=lambda entry: int((entry[0] - start) / SECOND) ^ 1)
    results = []
    for name, written in (("sound", entries), ("swapped", swapped)):
        path = tmp_path / f"{name}.{kind}"
        if kind == "bag":
            foreign.write_rosbag1(path, written)
        elif kind == "mcap":
            foreign.write_mcap(path, written)
        else:
            path = foreign.write_rosbag2(tmp_path / name, written)
        (entry,) = find_logs(path)
        results.append(make_trajectories(read_log(entry, machine), machine, config, loop_tracker))
    assert_same_rows(results[1], results[0])
    assert "put in order" in texts(results[1]) and "put in order" not in texts(results[0])
