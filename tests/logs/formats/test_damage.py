"""Damaged logs: what is before the damage is recovered, the line says where and what was lost, nothing else happens.

The list of cases is the folder `damage`; docs/log_damage.md shows it with what comes of each.
"""

import hashlib
import os
import re
import resource
import shutil
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader

from benchmarks.log_damage import row
from pipeline.configuration.load import load_machine
from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.messages.raw_log import NoteKind
from tests.logs.conftest import REPOSITORY
from tests.logs.damage import CASES
from tests.logs.damage.case import EVERY_KIND, REFUSED, Where
from tests.logs.damage.outcome import (
    DEADLINE_S,
    FULL_DISK_FILE_BYTES,
    deadline,
    give_up_rights,
    outcome_of,
    outcomes,
)
from tests.logs.samples import can_logs
from tests.logs.samples.whole_logs import (
    BAGS,
    LEROBOT,
    MCAP_CHUNKED,
    SQLITE,
    TABLES,
    recorded,
    whole_log,
)

few = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

MAXIMUM_PROCESSOR_S = 10.0  # the slowest case takes five on a slow machine; without a bound, minutes
MAXIMUM_GROWTH_BYTES = 300 << 20  # of which compiling takes 120 MB; the bombs would take 360 MB and more
MAXIMUM_LINE = 1000
PAGE = (REPOSITORY / "docs/log_damage.md").read_text(encoding="utf-8")
ELSEWHERE = (Where.fused, Where.unprivileged)

# Cases that are not yet passed, with the reason. One that passes fails: its line here must go then.

# --- The list


@pytest.fixture(scope="module")
def run_elsewhere(tmp_path_factory):
    """Cases that need a process of their own share one; it is started when the first of them is wanted."""
    found = {}

    def run(wanted):
        if wanted not in found:
            built = []
            for case in CASES:
                if case.where is not wanted.where:
                    continue
                folder = tmp_path_factory.mktemp("damaged")
                built.append((case, case.build(folder), folder / "output"))
            found.update(
                {
                    case: (damaged, outcome, output.parent)
                    for (case, damaged, output), outcome in zip(built, outcomes(built), strict=True)
                }
            )
        return found[wanted]

    yield run
    for damaged, _, _ in found.values():
        for folder in (damaged.path, damaged.path.parent / "output"):
            if folder.is_dir():
                folder.chmod(0o755)  # or nobody but root could remove it


@pytest.mark.parametrize(
    "case", [pytest.param(c, marks=pytest.mark.long if c.where in ELSEWHERE else []) for c in CASES], ids=str
)
def test_damage(case, tmp_path, run_elsewhere):
    if case.where in ELSEWHERE:
        damaged, outcome, folder = run_elsewhere(case)
    else:
        damaged, folder = case.build(tmp_path), tmp_path
        before = contents(tmp_path)
        ((outcome,), after) = outcomes([(case, damaged, tmp_path / "output")]), contents(tmp_path)
        assert after == before, "the user's files are changed"
    n_whole = damaged.n_whole or whole_log(case.kind).n_messages
    told = "\n".join(outcome.lines)
    assert outcome.status == damaged.status, told
    assert damaged.at_least <= outcome.recovered <= n_whole, told
    assert outcome.lines or outcome.recovered == n_whole, "something is lost, and nobody is told"
    for said in damaged.says:
        assert re.search(said, told), told
    for line in outcome.lines:
        assert line.isprintable() and len(line) < MAXIMUM_LINE, line
    assert f"{row(case, damaged, outcome, folder)}\n" in PAGE, (
        "run `python -m benchmarks.log_damage > docs/log_damage.md`"
    )
    assert outcome.processor_s < MAXIMUM_PROCESSOR_S
    if case.where in ELSEWHERE:
        assert outcome.grown_bytes < MAXIMUM_GROWTH_BYTES
    elif damaged.status == 0:
        assert_recorded(damaged.path, damaged.may_differ)


def contents(folder):
    """Names and digests of all files, but those of the output."""
    return {
        path.relative_to(folder): hashlib.sha256(path.read_bytes()).digest()
        for path in folder.rglob("*")
        if path.is_file() and "output" not in path.relative_to(folder).parts[0]
    }


def assert_recorded(path, may_differ):
    """All but so many samples are bit for bit what was recorded, each once, in order."""
    raw, session = read(path), recorded()
    if path.is_dir() and (path / "meta").exists():
        rows = np.rint((raw.joint_log_time_ns / 1e9 - 100.0) / 0.02).astype(int)
        same = [(raw.q == session.q[rows].astype(np.float32)).all(axis=1)]
    elif path.suffix in (".csv", ".parquet"):
        rows = np.rint((raw.joint_log_time_ns / 1e9 - 100.0) / 0.02).astype(int)
        same = [(raw.q == session.q[rows]).all(axis=1)]
    elif path.suffix in can_logs.WRITERS:
        order = np.argsort(session.stamp_ns)
        start = 0 if path.suffix != ".asc" else raw.joint_log_time_ns[0] - session.stamp_ns[order[0]]
        rows = np.searchsorted(session.stamp_ns[order], raw.joint_log_time_ns - start - 1_000_000).clip(
            max=len(session.q) - 1
        )
        same = [(np.abs(raw.q - can_logs.rounded_q(session)[order][rows]) < 1e-9).all(axis=1)]
    else:
        rows = np.searchsorted(session.log_time_ns, raw.joint_log_time_ns).clip(max=len(session.q) - 1)
        commands = np.searchsorted(session.command_ns, raw.command_log_time_ns).clip(
            max=len(session.command) - 1
        )
        alike = (raw.joint_log_time_ns == session.log_time_ns[rows]) & (
            raw.joint_stamp_ns == session.stamp_ns[rows]
        )
        same = [
            alike & (raw.q == session.q[rows]).all(axis=1),
            (raw.command_log_time_ns == session.command_ns[commands])
            & (raw.command == session.command[commands]).all(axis=1),
        ]
        assert (np.diff(commands[same[1]]) > 0).all()
    assert (np.diff(rows[same[0]]) > 0).all()
    assert sum(int((~part).sum()) for part in same) <= may_differ


def read(path):
    (entry,) = find_logs(path)
    with deadline(DEADLINE_S):
        return read_log(entry, load_machine("bobcat_e10"))


def test_every_kind_of_log_is_on_the_list():
    """A whole log of every kind is read without a word, so that what the list says is about the damage."""
    assert {case.kind for case in CASES} == {*EVERY_KIND, LEROBOT}
    assert len({str(case) for case in CASES}) == len(CASES)


@pytest.mark.parametrize("kind", EVERY_KIND)
def test_whole_logs_need_no_line(kind, tmp_path):
    log = whole_log(kind)
    outcome = outcome_of(log.write(tmp_path / "a"), tmp_path / "output")
    assert (outcome.recovered, outcome.lines, outcome.status) == (log.n_messages, [], 0)
    assert_recorded(tmp_path / f"a{log.suffix}", 0)


# --- Damage anywhere


@pytest.mark.parametrize("kind", [kind for kind in BAGS if kind != SQLITE])
@few
@given(share=st.floats(0, 1))
def test_cut_off_anywhere(tmp_path, kind, share):
    """A crash of the recorder: every message before the cut is read, as it was recorded."""
    log, session = whole_log(kind), recorded()
    cut = int(share * len(log.content))
    path = log.write(tmp_path / "a", log.content[:cut])
    try:
        raw = read(path)
    except InputError as error:
        assert "\n" not in str(error)
        assert log.n_before(cut) < 10, f"joint states and commands stand before the cut, yet: {error}"
        return
    assert len(raw.q) + len(raw.command) >= log.n_before(cut)
    np.testing.assert_array_equal(raw.joint_stamp_ns, session.stamp_ns[: len(raw.q)])
    np.testing.assert_array_equal(raw.command_log_time_ns, session.command_ns[: len(raw.command)])
    assert_recorded(path, 0)
    if len(raw.q) < len(session.q):
        assert any(note.kind is NoteKind.damage and path.name in note.text for note in raw.notes)


@pytest.mark.parametrize("kind", [kind for kind in BAGS if kind.startswith("ROS 1")])
def test_a_bag_that_ends_just_where_a_record_does_is_cut_off_all_the_same(tmp_path, kind):
    log = whole_log(kind)
    with Reader(
        log.write(tmp_path / "whole")
    ) as reader:  # the reference reader's index says where chunks begin
        begins = [info.pos for info in reader.chunk_infos]
    for cut in begins[1:]:
        raw = read(log.write(tmp_path / "a", log.content[:cut]))
        assert any(note.kind is NoteKind.damage for note in raw.notes)


def test_cut_database_gives_what_was_recorded(tmp_path):
    """The later rows of a page stand in front of the earlier ones, so of a half page rows may be had, whole ones."""
    log = whole_log(SQLITE)
    for cut in range(45_000, len(log.content), 5_003):
        path = log.write(tmp_path / "a", log.content[:cut])
        raw = read(path)
        assert len(raw.q) + len(raw.command) >= log.n_before(cut)
        assert_recorded(path, 0)


@few
@given(share=st.floats(0.05, 0.95), bit=st.integers(0, 7))
@pytest.mark.parametrize("kind", MCAP_CHUNKED)
def test_bit_flip_costs_one_chunk(tmp_path, kind, share, bit):
    """With checksums a flip in a chunk costs that chunk; every sample that is read was recorded."""
    log = whole_log(kind)
    chunk = log.chunks[int(share * len(log.chunks))]
    content = bytearray(log.content)
    content[chunk.data + int(share * (chunk.end - chunk.data))] ^= 1 << bit
    path = log.write(tmp_path / "a", bytes(content))
    raw = read(path)
    assert_recorded(path, 0)
    if len(raw.q) + len(raw.command) == log.n_messages:
        return  # a bit that the decompressor does not look at: the checksum holds
    assert len(raw.q) + len(raw.command) == log.n_messages - chunk.n_messages
    (note,) = [note for note in raw.notes if note.kind is NoteKind.damage]
    assert f"byte {chunk.start}" in note.text


@few
@given(data=st.data())
@pytest.mark.parametrize("kind", EVERY_KIND)
def test_any_damage_gives_a_log_or_one_line(tmp_path, kind, data):
    log = whole_log(kind)
    damaged = bytearray(log.content)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(damaged) - 1))
        piece = data.draw(st.binary(min_size=1, max_size=12))
        damaged[at : at + len(piece)] = piece
    try:
        read(log.write(tmp_path / "a", bytes(damaged)))
    except InputError as error:
        assert "\n" not in str(error)


# --- A full disk


@pytest.mark.parametrize("kind", ["ROS 1, lz4", SQLITE])
def test_full_disk_is_made_up_for_when_there_is_room(tmp_path, kind):
    """Wherever the disk is full, no tuples are left that no record vouches for; with room the result is the usual."""
    path, output = whole_log(kind).write(tmp_path / "a"), tmp_path / "output"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    statuses = []
    for limit in (0, 1 << 10, 1 << 13, 1 << 14, 1 << 15, 1 << 16, 1 << 20):
        shutil.rmtree(output, ignore_errors=True)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
        try:
            outcome = outcome_of(path, output)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        statuses.append(outcome.status)
        left = sorted(file.name for file in output.iterdir())
        assert left == ([] if outcome.status else ["a.ingest.json", "a.parquet"])
        assert outcome.status == 0 or "File too large); make room" in outcome.lines[0]
        assert outcome_of(path, output).status == 0
        assert outcome_of(path, tmp_path / "other").status == 0
        assert (output / "a.parquet").read_bytes() == (tmp_path / "other/a.parquet").read_bytes()
    assert statuses[0] == REFUSED and statuses[-1] == 0


# --- The command


def command(*overrides, folder, before=None):
    """Run the stage; `before` runs in the new process first."""
    return subprocess.run(
        [sys.executable, "-m", "pipeline.stages.ingest", *overrides, "output=tuples", "tracking=none"],
        capture_output=True,
        text=True,
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(REPOSITORY)},
        preexec_fn=before,
        check=False,
    )


def test_command_names_what_failed_in_one_line_and_writes_the_rest(tmp_path):
    """A good log, a damaged one, and one failure of every sort, one of them unreadable even to root."""
    logs = tmp_path / "logs"
    logs.mkdir()
    good, cut = whole_log("MCAP, zstd"), whole_log("ROS 1")
    good.write(logs / "good")
    cut.write(logs / "cut", cut.content[: cut.ends[500]])
    for kind in ("ROS 1", "MCAP", SQLITE, *TABLES):
        whole_log(kind).write(logs / f"empty{kind[:3]}", b"")
        whole_log(kind).write(logs / f"noise{kind[:3]}", b"\x1b[31m\n\x00" * 500)
    good.write(logs / "locked").chmod(0)
    result = command(f"logs={logs}", "page=false", folder=tmp_path, before=give_up_rights)
    assert result.returncode == REFUSED
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ingest: 11 of 13 logs failed: ") and "Permission denied" in line
    failed = {path.name for path in logs.iterdir()} - {"good.mcap", "cut.bag"}
    page = (tmp_path / "tuples/quality.html").read_text()
    assert len(failed) == 11 and all(name in line and name in page for name in failed)
    assert "Traceback" not in result.stdout
    tuples = {path.name for path in (tmp_path / "tuples").glob("*.parquet")}
    assert tuples == {"good.parquet", "cut.parquet"}


def test_command_on_a_full_disk(tmp_path):
    whole_log("MCAP, zstd").write(tmp_path / "a")

    def fill():
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_DISK_FILE_BYTES, FULL_DISK_FILE_BYTES))

    result = command("logs=a.mcap", folder=tmp_path, before=fill)
    assert result.returncode == REFUSED
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: ") and "File too large" in line
    assert not list((tmp_path / "tuples").glob("*.parquet"))
