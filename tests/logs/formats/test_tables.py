"""Tables as other tools write them: times of every kind, text encodings, ragged rows; against the written numbers."""

import datetime
import time
from dataclasses import replace

import numpy as np
import polars
import pytest

from pipeline.errors import InputError
from pipeline.logs.describe.describe import describe
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest import ingest
from pipeline.machine.log_sources import ChannelSource, CommandSource
from tests.logs.samples.whole_logs import write_table

UTC = datetime.UTC


@pytest.fixture
def table(tmp_path) -> polars.DataFrame:
    (tmp_path / "other").mkdir()
    return polars.read_csv(write_table(tmp_path / "other" / "a.csv"))


@pytest.fixture
def read(machine, tmp_path):
    def read():
        (entry,) = find_logs(tmp_path / "logs")
        return read_log(entry, machine)

    (tmp_path / "logs").mkdir()
    return read


@pytest.fixture
def refusal(read):
    """The one line, which names the file of the user."""

    def refused(tmp_path) -> str:
        with pytest.raises(InputError) as failure:
            read()
        line = str(failure.value)
        assert line.startswith(f"{tmp_path / 'logs' / 'a.'}") and "\n" not in line
        return line

    return refused


@pytest.mark.parametrize(
    "dtype",
    [
        polars.Datetime("ns"),
        polars.Datetime("us"),
        polars.Datetime("ms"),
        polars.Datetime("us", "Europe/Zurich"),
        polars.Duration("ns"),
        polars.Duration("ms"),
        polars.Time,
    ],
    ids=str,
)
def test_temporal_columns_have_their_own_unit(table, read, tmp_path, dtype):
    milliseconds = 1_000_000 + 20 * np.arange(len(table))
    unit = {"ns": 1_000_000, "us": 1000, "ms": 1}[getattr(dtype, "time_unit", "ns")]
    t = polars.Series("t", milliseconds * unit, polars.Int64).cast(dtype)
    table.with_columns(t).write_parquet(tmp_path / "logs" / "a.parquet")
    raw = read()
    np.testing.assert_array_equal(raw.joint_log_time_ns, milliseconds * 1_000_000)
    np.testing.assert_array_equal(raw.q[:, 0], table["q_swing"])


def test_days_are_times_too(read, table, tmp_path):
    dates = polars.Series("t", [datetime.date(2024, 5, 6)] * len(table))
    table.with_columns(dates).write_parquet(tmp_path / "logs" / "a.parquet")
    expected = datetime.datetime(2024, 5, 6, tzinfo=UTC).timestamp() * 1e9
    assert set(read().joint_log_time_ns.tolist()) == {int(expected)}


def test_dates_in_text_are_refused_with_the_unit(table, refusal, tmp_path):
    start = datetime.datetime(2024, 5, 6, 9, tzinfo=UTC)
    times = [str(start + datetime.timedelta(milliseconds=20 * row)) for row in range(len(table))]
    table.with_columns(polars.Series("t", times)).write_csv(tmp_path / "logs" / "a.csv")
    line = refusal(tmp_path)
    assert (
        "column t holds `2024-05-06 09:00:00+00:00`, not a number of s; time_unit may be s, ms, us, ns"
        in line
    )


def test_nanoseconds_taken_for_seconds_are_refused_with_the_unit(table, refusal, tmp_path):
    times = 1_700_000_000_000_000_000 + 20_000_000 * np.arange(len(table))
    table.with_columns(polars.Series("t", times)).write_csv(tmp_path / "logs" / "a.csv")
    assert "column t holds `1700000000000000000`, not a number of s" in refusal(tmp_path)


def test_milliseconds_taken_for_seconds_are_told_by_their_distance(
    table, tmp_path, machine, config, loop_tracker
):
    (tmp_path / "logs").mkdir()
    table.with_columns(t=20 * polars.int_range(len(table))).write_csv(tmp_path / "logs" / "a.csv")
    (failure,) = ingest(machine, tmp_path / "logs", tmp_path / "out", config, loop_tracker).failures
    assert "joint samples, 20 s apart" in failure.reason


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf16_is_refused_by_name(table, refusal, tmp_path, encoding):
    (tmp_path / "logs" / "a.csv").write_bytes(table.write_csv().encode(encoding))
    assert "text in UTF-16; save it as UTF-8" in refusal(tmp_path)


@pytest.mark.parametrize("kind", ["list", "binary", "categorical"])
def test_columns_that_hold_no_numbers_are_named(table, refusal, tmp_path, kind):
    column = polars.col("q_boom")
    other = {
        "list": polars.concat_list(column),
        "binary": column.cast(polars.String).cast(polars.Binary),
        "categorical": column.cast(polars.String).cast(polars.Categorical),
    }[kind]
    table.with_columns(q_boom=other).write_parquet(tmp_path / "logs" / "a.parquet")
    line = refusal(tmp_path).lower()
    assert f"column q_boom holds {kind}" in line and "not numbers" in line


def test_the_line_about_the_front_of_a_damaged_file_names_the_file(table, refusal, tmp_path):
    text = table.rename({"q_boom": "boom"}).write_csv().encode()
    (tmp_path / "logs" / "a.csv").write_bytes(text[:5000] + b"\0" * 100 + text[5100:])
    assert "column q_boom is missing" in refusal(tmp_path)


def test_a_damaged_page_of_many_rows_is_passed_over_quickly(read, tmp_path, machine):
    """Its 100,000 rows are lost, exactly those, and none of them is tried alone."""
    n_rows, rng = 200_000, np.random.default_rng(0)
    columns = {"t": 0.02 * np.arange(n_rows)}
    columns |= {
        f"{prefix}_{joint}": rng.normal(size=n_rows) for joint in machine.joint_names for prefix in "qa"
    }
    path = tmp_path / "logs" / "a.parquet"
    polars.DataFrame(columns).write_parquet(path, row_group_size=n_rows // 2)
    content = bytearray(path.read_bytes())
    content[len(content) // 4 : len(content) // 4 + 64] = bytes(64)
    path.write_bytes(content)
    before = time.process_time()
    raw = read()
    assert time.process_time() - before < 3
    np.testing.assert_array_equal(raw.joint_log_time_ns[[0, -1]], [2_000_000_000_000, 3_999_980_000_000])
    (note,) = raw.notes
    assert "rows 0 to 99999 cannot be read" in note.text and len(raw.q) == n_rows // 2


def test_rows_with_a_stray_comma_are_left_out_and_told(table, read, tmp_path):
    lines = table.write_csv().splitlines()
    broken = range(10, 310, 10)
    for row in broken:
        cells = lines[1 + row].split(",")
        lines[1 + row] = ",".join([cells[0], *cells[1].split("."), *cells[2:]])  # a decimal comma
    (tmp_path / "logs" / "a.csv").write_text("\n".join(lines))
    raw = read()
    kept = np.delete(np.arange(len(table)), broken)
    np.testing.assert_array_equal(raw.q, table.select(polars.selectors.starts_with("q_")).to_numpy()[kept])
    (note,) = raw.notes
    assert note.count == 30 and "a.csv: 30 rows left out: they hold more values than" in note.text


def test_a_table_that_begins_at_zero_has_a_time(table, tmp_path, machine, config, loop_tracker):
    (tmp_path / "logs").mkdir()
    table.with_columns(polars.col("t") - polars.col("t").first()).write_csv(tmp_path / "logs" / "a.csv")
    (report,) = ingest(machine, tmp_path / "logs", tmp_path / "out", config, loop_tracker).reports
    assert report.notes == [] and report.line == f"{report.name}: {report.metrics['n_rows']} rows, 12 s"


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_cells_of_channels_that_are_no_numbers_are_told(table, tmp_path, machine, suffix):
    cells = ["warm", None, *(str(float(row)) for row in range(len(table) - 2))]
    with_oil = table.with_columns(polars.Series("oil", cells))
    (tmp_path / "logs").mkdir()
    getattr(with_oil, f"write_{suffix}")(tmp_path / "logs" / f"a.{suffix}")
    described = replace(machine, channels=[ChannelSource("oil", column="oil")])
    raw = read_log(find_logs(tmp_path / "logs")[0], described)
    np.testing.assert_array_equal(raw.channels["oil"].value, np.arange(len(table) - 2))
    told = {note.text: note.is_usual for note in raw.notes}
    prefix = f"a.{suffix}: cells of the channel's column oil are"
    strange = f"{prefix} not numbers: 1, first `warm` in row 1; write numbers or map another column"
    assert told == {strange: False, f"{prefix} empty: 1": True}


def test_a_channel_without_numbers_or_without_its_column_costs_no_row(table, tmp_path, machine):
    (tmp_path / "logs").mkdir()
    times = polars.lit(datetime.datetime(2026, 1, 2, tzinfo=UTC))
    columns = {"pair": polars.concat_list("q_boom", "q_arm"), "since": times}
    table.with_columns(**columns).write_parquet(tmp_path / "logs" / "a.parquet")
    channels = [ChannelSource(name, column=name) for name in ("pair", "since", "oil")]
    raw = read_log(find_logs(tmp_path / "logs")[0], replace(machine, channels=channels))
    assert len(raw.q) == len(table) and not raw.channels
    pair, since, oil = (note.text for note in raw.notes)
    assert f"column pair are not numbers: {len(table)}, first `[" in pair and "column since" in since
    assert oil == "channel oil: a.parquet has no column `oil`"


@pytest.mark.parametrize(("mark", "name"), [(";", "semicolons"), ("\t", "tabs")])
def test_another_separator_is_named(table, refusal, tmp_path, mark, name):
    table.write_csv(tmp_path / "logs" / "a.csv", separator=mark)
    assert f"its columns are separated by {name}; save it with commas" in refusal(tmp_path)
    with pytest.raises(InputError, match=f"separated by {name}"):
        describe(tmp_path / "logs")


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
@pytest.mark.parametrize(
    ("column", "cell", "remedy"),
    [("q_arm", "0,512", "with a decimal point"), ("a_arm", "up", "or map another column")],
)
@pytest.mark.parametrize("n_bad", [3, 600])
def test_words_and_decimal_commas_are_named_by_cell(
    table, tmp_path, machine, config, loop_tracker, suffix, column, cell, remedy, n_bad
):
    """Few cost their rows and are told; many refuse the log, and the line names the first."""
    n_bad = min(n_bad, len(table) - 7)
    cells = [cell if 7 <= row < 7 + n_bad else str(value) for row, value in enumerate(table[column])]
    cells[2] = "NA"  # which is how R writes an empty cell
    (tmp_path / "logs").mkdir()
    spoilt = table.with_columns(polars.Series(column, cells))
    getattr(spoilt, f"write_{suffix}")(tmp_path / "logs" / f"a.{suffix}")
    summary = ingest(machine, tmp_path / "logs", tmp_path / "out", config, loop_tracker)
    told = [note.text for report in summary.reports for note in report.notes]
    told += [failure.reason for failure in summary.failures]
    expected = f"a.{suffix}: cells of column {column} are not numbers: {n_bad}, first `{cell}` in row 8"
    (line,) = [text for text in told if expected in text]
    assert line.endswith(f"write numbers {remedy}")
    assert len(summary.failures) == (n_bad > 3)


def test_positions_in_degrees_are_told_with_the_scale(table, tmp_path, machine, config, loop_tracker):
    (tmp_path / "logs").mkdir()
    in_degrees = polars.selectors.starts_with("q_") * (180 / np.pi)
    table.with_columns(in_degrees).write_csv(tmp_path / "logs" / "a.csv")
    for stated in ([], [np.pi / 180]):
        described = replace(machine, joint_states=replace(machine.joint_states, scale=stated))
        summary = ingest(described, tmp_path / "logs", tmp_path / f"out{len(stated)}", config, loop_tracker)
        told = " ".join(text for report in summary.reports for text in report.warnings)
        told += " ".join(failure.reason for failure in summary.failures)
        assert (
            "times its limits" in told and "look like degrees; set joint_states.scale to 0.01745" in told
        ) == (not stated)


@pytest.mark.parametrize("threshold", [float("nan"), float("inf"), -0.5])
def test_thresholds_are_numbers(threshold):
    with pytest.raises(InputError, match=r"commands\.threshold is .*; it must be a number"):
        CommandSource(threshold=threshold)
