"""Channels from bags and tables to the tuples, against a loop over rows and against the numbers as written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import InputError
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.ingest import ingest
from pipeline.logs.messages.raw_log import ChannelSamples, RawLog
from pipeline.logs.trajectories import make_trajectories
from pipeline.logs.tuples import read_tuples, validation_part
from pipeline.machine.log_sources import ChannelSource, ClockChoice
from pipeline.reporting.pages.quality import quality_page
from tests.logs.conftest import make_session
from tests.logs.samples import foreign_bags as foreign

SECOND = 1_000_000_000


def held(rows_ns, time_ns, value, hold_s):
    """Row by row: the last value that is a number, at or before the row, and not too old."""
    result = []
    for row in rows_ns:
        past = [
            (at, number)
            for at, number in zip(time_ns, value, strict=True)
            if at <= row and np.isfinite(number)
        ]
        at, number = max(past, key=lambda pair: pair[0], default=(None, np.nan))
        result.append(number if at is not None and row - at <= hold_s * SECOND else np.nan)
    return np.array(result)


@given(st.data())
def test_against_a_row_by_row_reference(machine, config, loop_tracker, data):
    session = make_session(machine, seconds=8)
    n = data.draw(st.integers(0, 30))
    time_ns = np.sort(data.draw(st.lists(st.integers(-1000, 9000), min_size=n, max_size=n, unique=True)))
    time_ns = session.stamp_ns[0] + np.array(time_ns, np.int64) * 1_000_000
    number = st.floats(-1e6, 1e6) | st.just(float("nan"))
    value = np.array(data.draw(st.lists(number, min_size=n, max_size=n)), np.float64)
    hold_s = data.draw(st.sampled_from([0.05, 0.4, 3.0]))
    channels = [ChannelSource("absent", column="c"), ChannelSource("level", column="c", hold_s=hold_s)]
    raw = RawLog(
        "a",
        Path("a"),
        session.stamp_ns,
        session.log_time_ns,
        session.q,
        session.command_ns,
        session.command,
        channels={"level": ChannelSamples(time_ns, value)},
    )
    settings = replace(config, maximum_gap_s=20.0)  # so that no value counts as one with a damaged stamp
    section = data.draw(st.integers(1, 400))
    result = make_trajectories(raw, replace(machine, channels=channels), settings, loop_tracker, section)
    (rows,) = result.trajectories
    np.testing.assert_array_equal(rows.channels["level"], held(rows.stamp_ns, time_ns, value, hold_s))
    assert np.isnan(rows.channels["absent"]).all()


CHANNELS = [
    ChannelSource("pressure", "/pressure", "fluid_pressure", "p_bar", unit="Pa", hold_s=0.3),
    ChannelSource("second", "/levels", "data[1]", unit="1", clock=ClockChoice.log_time),
    ChannelSource("stamped", "/pressure", "variance", unit="1", clock=ClockChoice.header_stamp),
    ChannelSource("absent", "/absent", "data", "nowhere", unit="V"),
]


@pytest.fixture
def wired(machine):
    return replace(machine, channels=CHANNELS)


def pressure(stamp_ns, value, variance):
    types = foreign.ROS2.types
    header = foreign.joint_state(foreign.ROS2, stamp_ns, [], []).header
    return types["sensor_msgs/msg/FluidPressure"](header=header, fluid_pressure=value, variance=variance)


@pytest.fixture
def logged(session, machine, tmp_path):
    """A bag with levels, and pressures at 10 Hz with a hole, stamped 40 ms before they are logged."""
    time_ns = session.command_ns[0] + np.arange(0, 18 * SECOND, SECOND // 10)
    time_ns = time_ns[(time_ns < time_ns[60]) | (time_ns > time_ns[80])]
    value = 1e7 + 1e5 * np.sin(np.arange(len(time_ns)))
    entries = foreign.messages(foreign.ROS2, session, machine.joint_names)
    entries += [
        (int(at), "/pressure", pressure(int(at) - 40_000_000, number, 2 * number))
        for at, number in zip(time_ns, value, strict=True)
    ]
    entries += [(int(at), "/levels", foreign.array(foreign.ROS2, [0, 7], "Float32")) for at in time_ns[:2]]
    foreign.write_mcap(tmp_path / "logs" / "a.mcap", sorted(entries, key=lambda entry: entry[0]))
    return time_ns, value


def test_fields_of_any_message_into_the_tuples(logged, wired, config, loop_tracker, tmp_path):
    time_ns, value = logged
    summary = ingest(wired, tmp_path / "logs", tmp_path / "tuples", config, loop_tracker)
    frame = polars.read_parquet(tmp_path / "tuples" / "a.parquet")
    rows_ns, expected = frame["stamp"].to_numpy(), {}
    expected["pressure"] = held(rows_ns, time_ns, value, 0.3)
    expected["second"] = held(rows_ns, time_ns[:2], [7.0, 7.0], 5.0)
    expected["stamped"] = held(rows_ns, time_ns - 40_000_000, 2 * value, 5.0)
    expected["absent"] = np.full(len(frame), np.nan)
    assert frame.columns[-5:] == [*(f"x_{channel.name}" for channel in CHANNELS), "split"]
    (rows,) = read_tuples(tmp_path / "tuples", wired)
    for name, values in expected.items():
        assert frame[f"x_{name}"].null_count() == np.isnan(values).sum()
        np.testing.assert_array_equal(frame[f"x_{name}"].fill_null(float("nan")), values)
        np.testing.assert_array_equal(rows.channels[name], values)
    assert 60 < frame["x_pressure"].null_count() < 80  # the hole and the end
    np.testing.assert_array_equal(
        validation_part(rows).channels["pressure"], expected["pressure"][rows.is_validation]
    )
    (report,) = summary.reports
    assert report.metrics["x_pressure/n"] == len(time_ns) and report.metrics["x_absent/n"] == 0
    assert report.metrics["x_pressure/min"] == pytest.approx(np.nanmin(expected["pressure"]), rel=1e-5)
    assert report.metrics["x_absent/max"] is None and report.metrics["x_absent/share_unknown"] == 1.0
    page = quality_page(wired, None, summary, tmp_path / "tuples")
    assert "Channels" in page and "not in this log" in page and "1.01e+07 Pa" in page
    assert report.line == f"a: {len(frame)} rows, 20 s"


def test_rows_do_not_depend_on_channels(logged, wired, machine, config, loop_tracker, tmp_path):
    for name, of in (("with", wired), ("without", replace(machine, channels=[]))):
        ingest(of, tmp_path / "logs", tmp_path / name, config, loop_tracker)
    one, other = (polars.read_parquet(tmp_path / name / "a.parquet") for name in ("with", "without"))
    assert one.select(other.columns).equals(other) and set(one.columns) - set(other.columns) == {
        f"x_{channel.name}" for channel in CHANNELS
    }
    (rows,) = read_tuples(tmp_path / "without", wired)  # tuples of before the channels were declared
    assert rows.channels == {}


def test_columns_of_a_table(session, wired, config, loop_tracker, tmp_path):
    (tmp_path / "logs").mkdir()
    n_rows, joints = len(session.command), wired.joint_names
    level = np.where(np.arange(n_rows) % 3 == 0, np.arange(n_rows) / 8, np.nan)
    columns = {"t": 0.05 * np.arange(n_rows), "p_bar": level}
    columns |= {f"q_{joint}": session.q[:n_rows, number] for number, joint in enumerate(joints)}
    columns |= {f"a_{joint}": session.command[:, number] for number, joint in enumerate(joints)}
    polars.DataFrame(columns).fill_nan(None).write_csv(tmp_path / "logs" / "a.csv")
    ingest(wired, tmp_path / "logs", tmp_path / "tuples", config, loop_tracker)
    frame = polars.read_parquet(tmp_path / "tuples" / "a.parquet")
    np.testing.assert_array_equal(frame["x_pressure"], np.repeat(level[::3], 3)[: len(frame)])
    assert frame["x_absent"].null_count() == len(frame)


def test_a_channel_that_cannot_be_read_is_told_and_costs_no_row(logged, machine, tmp_path):
    channels = [
        ChannelSource("wrong", "/levels", "nothing"),
        ChannelSource("text", "/pressure", "header.frame_id"),
    ]
    (entry,) = find_logs(tmp_path / "logs")
    raw = read_log(entry, replace(machine, channels=channels))
    assert raw.channels == {} and len(raw.q) == 1000
    assert [note.text for note in raw.notes] == [
        "channel wrong: none of the 2 messages of /levels can be used: they have no number field `nothing`",
        f"channel text: none of the {len(logged[0])} messages of /pressure can be used: they have no number field "
        "`header.frame_id`",
    ]


def test_a_channel_whose_clock_steps_back_alone_is_left_out(session, machine, config, loop_tracker):
    time_ns = np.concatenate([session.stamp_ns[:500], session.stamp_ns[:500]])
    raw = RawLog(
        "a",
        Path("a"),
        session.stamp_ns,
        session.log_time_ns,
        session.q,
        session.command_ns,
        session.command,
        channels={"level": ChannelSamples(time_ns, np.ones(len(time_ns)))},
    )
    of = replace(machine, channels=[ChannelSource("level", column="c")])
    result = make_trajectories(raw, of, config, loop_tracker)
    assert np.isnan(result.trajectories[0].channels["level"]).all()
    assert any("channel level: its clock steps back 1 times" in note.text for note in result.notes)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"name": "a b", "column": "c"}, "name `a b`"),
        ({"name": "a", "topic": "/a"}, "a needs a topic and a field, or a column"),
        ({"name": "a", "column": "c", "hold_s": 0.0}, "hold_s of a is 0"),
        ({"name": "a", "column": "c", "clock": ClockChoice.automatic}, "clock of a is automatic"),
    ],
)
def test_wrong_channels_are_refused(arguments, said):
    with pytest.raises(InputError, match=said):
        ChannelSource(**arguments)


def test_channels_with_one_name_are_refused(machine):
    twice = [ChannelSource("a", column="c"), ChannelSource("a", column="d")]
    with pytest.raises(InputError, match="channels repeat a name: a, a"):
        replace(machine, channels=twice)
