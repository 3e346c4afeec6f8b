"""What the terminal says of a log: rows, seconds, and what was lost where."""

import pytest

from pipeline.logs.messages.notes import NoteList
from pipeline.logs.messages.raw_log import Note, NoteKind
from pipeline.logs.quality import QualityReport
from pipeline.logs.telling import cautions
from pipeline.logs.trajectories import load_logs
from tests.logs.conftest import make_session
from tests.stages.command import run_stage

SOUND = {"n_rows": 240, "duration_s": 11.98, "n_trajectories": 1, "joint_states/n_gaps": 0}


def line(*notes: Note, **metrics: float) -> str:
    return QualityReport("a", {**SOUND, **metrics}, list(notes), []).line


def test_gaps_and_what_they_split_stand_in_the_line():
    gaps = {"n_trajectories": 3, "joint_states/n_gaps": 2, "joint_states/longest_gap_s": 2.345}
    told = "a: 240 rows, 12 s in 3 trajectories; 2 gaps between joint samples, the longest of 2.35 s"
    assert line(**gaps) == told
    assert line(n_rows=1, **{**gaps, "n_trajectories": 1, "joint_states/n_gaps": 1}).startswith(
        "a: 1 row, 12 s; 1 gap between"
    )


def test_of_a_sound_log_it_says_rows_and_seconds_only():
    early = Note(NoteKind.left_out, "joint samples before the first command", 3, is_usual=True)
    assert line() == line(early, Note(NoteKind.attention, "an encoder")) == "a: 240 rows, 12 s"


def test_damage_comes_first_and_the_rest_is_counted():
    lost = [Note(NoteKind.damage, f"a.mcap, byte {byte}: the chunk is lost") for byte in (10, 20, 30)]
    repeated = Note(NoteKind.left_out, "joint samples: their stamp repeats the one before", 7)
    split, late = Note(NoteKind.changed, "the log is split"), Note(NoteKind.left_out, "rows left out", 4)
    assert line(repeated, late, split, *lost) == (
        "a: 240 rows, 12 s; a.mcap, byte 10: the chunk is lost (and 2 like it); "
        "7 joint samples: their stamp repeats the one before; 2 more in the quality report"
    )


def test_notes_that_were_counted_only_are_more_of_their_kind():
    notes = NoteList()
    for byte in range(100):
        notes.append(Note(NoteKind.damage, f"a.mcap, byte {byte}: a record is lost"))
    assert line(*notes) == "a: 240 rows, 12 s; a.mcap, byte 0: a record is lost (and more like it)"
    assert line(Note(NoteKind.damage, "a.mcap, byte 7: a record is lost", 3)).endswith("is lost (3 times)")


def test_commands_that_read_logs_directly_get_cautions(session, machine, config, loop_tracker, tmp_path):
    session.write(tmp_path / "sound", machine)
    session.write(tmp_path / "late", machine, joint_state_header_stamp_ns=session.stamp_ns - 5 * 10**9)
    (text,) = cautions(load_logs(tmp_path, machine, config, loop_tracker))
    assert text.startswith("caution: late: the times of /joint_states are 5.00")


def test_long_texts_are_cut():
    assert len(line(Note(NoteKind.damage, "x" * 1000))) < 200


@pytest.fixture
def told(tmp_path, machine):
    """The stage's output for three logs: sound, cut in half, and with stamps of a clock that is 5 s off."""
    session = make_session(machine, seconds=10)
    session.write(tmp_path / "logs" / "sound", machine)
    session.write(
        tmp_path / "logs" / "late", machine, joint_state_header_stamp_ns=session.stamp_ns - 5 * 10**9
    )
    session.write(tmp_path / "logs" / "cut", machine, compression="none")
    (path,) = (tmp_path / "logs" / "cut").glob("*.mcap")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    result = run_stage("ingest", "logs=logs", "output=tuples", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines(), (tmp_path / "tuples" / "quality.html").read_text()


def test_the_stage_tells_each_log_in_a_line(told):
    lines, page = told
    (sound,), (cut,), (late,) = (
        [text for text in lines if text.startswith(name)] for name in ("sound:", "cut:", "late:")
    )
    assert sound == "sound: 200 rows, 10 s"
    assert "; cut_0.mcap, byte " in cut and int(cut.split()[1]) < 200
    (warning,) = [text for text in lines if "warning" in text]
    assert lines.index(warning) == lines.index(late) + 1 and "joint_states.clock" in warning
    verdict = page[page.index('class="verdict"') :]
    assert "Warning: late: the times of /joint_states are 5.00" in verdict[: verdict.index("</p>")]
