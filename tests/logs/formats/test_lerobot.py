"""LeRobot datasets: what is written is read back, and datasets of other people's robots by configuration alone."""

import json
from dataclasses import replace

import numpy as np
import polars
import pyarrow.parquet as pq
import pytest

from pipeline.errors import InputError
from pipeline.logs.describe.describe import describe
from pipeline.logs.export import lerobot
from pipeline.logs.export.lerobot import write_lerobot
from pipeline.logs.formats.bags import read_log
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.formats.discovery.log_entry import LogFormat
from pipeline.logs.formats.lerobot import frames
from pipeline.logs.formats.lerobot.dataset import MAXIMUM_EPISODES
from pipeline.logs.formats.lerobot.features import Element, element_of, names_of
from pipeline.logs.ingest import ingest
from pipeline.logs.trajectories import load_trajectories
from pipeline.logs.tuples import read_tuples
from pipeline.machine.log_sources import ChannelSource, LeRobotSource
from tests.logs.conftest import make_session
from tests.stages.command import run_stage


@pytest.fixture(scope="module")
def trajectories(machine, config, loop_tracker, tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags")
    for seed in range(3):
        make_session(machine, seconds=6 + seed, seed=seed).write(folder / f"bag{seed}", machine)
    return load_trajectories(folder, machine, config, loop_tracker)


@pytest.fixture
def dataset(tmp_path, machine, trajectories):
    write_lerobot(tmp_path / "data" / "arm", machine, trajectories, "dig")
    return tmp_path / "data" / "arm"


def test_trajectories_come_back(tmp_path, dataset, machine, trajectories, config, loop_tracker):
    """The same rows at the same absolute times; positions have float32's resolution."""
    summary = ingest(machine, dataset.parent, tmp_path / "tuples", config, loop_tracker)
    assert not summary.failures and not [
        note for report in summary.reports for note in report.notes if not note.is_usual
    ]
    found = read_tuples(tmp_path / "tuples", machine)
    assert [one.name for one in found] == [f"arm_episode_{number:06d}" for number in range(3)]
    for one, other in zip(found, trajectories, strict=True):
        np.testing.assert_array_equal(one.stamp_ns, other.stamp_ns)
        np.testing.assert_array_equal(one.a, other.a)
        np.testing.assert_allclose(one.q, other.q, rtol=2**-24, atol=0)


def test_second_run_reads_nothing(tmp_path, dataset, machine, config, loop_tracker):
    ingest(machine, dataset, tmp_path / "tuples", config, loop_tracker)
    assert ingest(machine, dataset, tmp_path / "tuples", config, loop_tracker).n_skipped == 3


def test_files_are_those_that_lerobot_expects(dataset, machine, trajectories):
    information = json.loads((dataset / "meta/info.json").read_text())
    n_frames = sum(map(len, trajectories))
    assert information["codebase_version"] == "v3.0" and information["fps"] == 20
    assert (information["total_episodes"], information["total_frames"]) == (3, n_frames)
    frames = polars.read_parquet(dataset / "data/chunk-000/file-000.parquet")
    assert set(frames.columns) == set(information["features"]) and len(frames) == n_frames
    assert frames["index"].to_list() == list(range(n_frames))
    episodes = polars.read_parquet(dataset / "meta/episodes/chunk-000/file-000.parquet")
    assert episodes["length"].to_list() == list(map(len, trajectories))
    assert episodes["dataset_to_index"][-1] == n_frames and episodes["tasks"].to_list() == [["dig"]] * 3
    tasks = pq.read_table(dataset / "meta/tasks.parquet")
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["__index_level_0__"]
    statistics = json.loads((dataset / "meta/stats.json").read_text())["observation.state"]
    q = np.concatenate([one.q for one in trajectories])
    np.testing.assert_allclose(statistics["mean"], q.mean(axis=0), rtol=1e-6)
    np.testing.assert_allclose(statistics["std"], q.std(axis=0), rtol=1e-6)
    assert statistics["count"] == [n_frames]


def test_without_stamps_time_is_counted_over_all_episodes(dataset, machine, trajectories):
    path = dataset / "data/chunk-000/file-000.parquet"
    polars.read_parquet(path).drop("stamp").write_parquet(path)
    begin = 0
    for entry, other in zip(find_logs(dataset), trajectories, strict=True):
        assert entry.format is LogFormat.lerobot
        raw = read_log(entry, machine)
        np.testing.assert_array_equal(raw.joint_stamp_ns, (begin + np.arange(len(other))) * 50_000_000)
        begin += len(other)


@pytest.mark.parametrize("column", ["stamp", "index", "frame_index"])
def test_a_frame_without_its_time_is_not_put_on_another_clock(dataset, machine, trajectories, column):
    path = dataset / "data/chunk-000/file-000.parquet"
    frames = polars.read_parquet(path) if column == "stamp" else polars.read_parquet(path).drop("stamp")
    row = len(trajectories[0]) + 5  # of the second episode
    emptied = polars.when(polars.int_range(len(frames)) != row).then(polars.col(column)).alias(column)
    frames.with_columns(emptied).write_parquet(path)
    raw = read_log(find_logs(dataset)[1], machine)
    period_ns = np.diff(raw.joint_stamp_ns)
    np.testing.assert_allclose(np.delete(period_ns, 4), 50_000_000, atol=1)
    assert period_ns[4] == (100_000_000 if column == "stamp" else 50_000_000)
    assert any("hold no time" in note.text for note in raw.notes) == (column == "stamp")


def test_a_robot_of_other_people(tmp_path, dataset, machine, trajectories):
    """Names with a suffix, in a dictionary, in another order; state and action in degrees."""
    path = dataset / "data/chunk-000/file-000.parquet"
    frames = polars.read_parquet(path)
    degrees = polars.col("observation.state").list.reverse().list.eval(polars.element().degrees())
    columns = frames.with_columns(polars.col("observation.state").cast(polars.List(polars.Float64)))
    columns = columns.with_columns(degrees)
    columns.drop("stamp").write_parquet(path)
    information = json.loads((dataset / "meta/info.json").read_text())
    names = [f"{joint}.pos" for joint in machine.joint_names]
    information["features"]["observation.state"]["names"] = {"motors": names[::-1]}
    information["features"]["action"]["names"] = None
    (dataset / "meta/info.json").write_text(json.dumps(information))
    source = LeRobotSource(["observation.state.{joint}.pos"], [f"action[{i}]" for i in range(4)])
    states = replace(machine.joint_states, scale=[np.pi / 180])
    raw = read_log(find_logs(dataset)[1], replace(machine, lerobot=source, joint_states=states))
    np.testing.assert_allclose(raw.q, trajectories[1].q, atol=1e-6)
    np.testing.assert_array_equal(raw.command, trajectories[1].a)
    with pytest.raises(
        InputError, match=r"feature observation\.state has no number `swing`; it has bucket\.pos"
    ):
        read_log(find_logs(dataset)[1], machine)


def test_elements_of_features():
    features = {"a": {"names": ["x", "b.y"]}, "a.b": {"names": {"p": 0, "q": 1}}, "c": {}}
    assert element_of("a.x", features, "") == Element("a", 0)
    assert element_of("a.b.q", features, "") == Element("a.b", 1)
    assert element_of("c[2]", features, "") == Element("c", 2) and element_of("c", features, "") == Element(
        "c", 0
    )
    assert names_of({"names": {"motors": ["x", "y"]}}) == {"x": 0, "y": 1}
    assert names_of({"names": ["x", "y", "x"]}) == {"y": 1} and not names_of({"names": {"x": 0, "y": None}})
    assert element_of("d.q", {"d": {"names": {"p": 2, "q": 0}}}, "") == Element("d", 0)
    with pytest.raises(InputError, match=r"no feature `d`; the dataset has a, a\.b, c"):
        element_of("d", features, "")
    with pytest.raises(InputError, match=r"has no number `z`; it has no names; use \[0\]"):
        element_of("c.z", features, "")


def test_existing_folder_and_no_trajectories(tmp_path, machine, trajectories):
    with pytest.raises(InputError, match="no trajectories to write"):
        write_lerobot(tmp_path / "a", machine, [], "dig")
    assert not list(tmp_path.iterdir())
    (tmp_path / "a").mkdir()
    with pytest.raises(InputError, match="exists already"):
        write_lerobot(tmp_path / "a", machine, trajectories, "dig")


def test_a_file_that_is_full_is_followed_by_another(tmp_path, machine, trajectories, monkeypatch):
    monkeypatch.setattr(lerobot, "FILE_MB", 0)
    assert write_lerobot(tmp_path / "a", machine, trajectories, "dig") == len(trajectories)
    assert len(list((tmp_path / "a/data").rglob("*.parquet"))) == len(trajectories)
    for entry, other in zip(find_logs(tmp_path / "a"), trajectories, strict=True):
        np.testing.assert_array_equal(read_log(entry, machine).command, other.a)


def test_command(tmp_path, dataset, machine, config, loop_tracker):
    ingest(machine, dataset, tmp_path / "tuples", config, loop_tracker)
    result = run_stage("export_lerobot", "tuples=tuples", "output=again", "task=dig deep", folder=tmp_path)
    assert result.returncode == 0, result.stderr
    for name in ("data/chunk-000/file-000.parquet", "meta/info.json", "meta/stats.json"):
        assert (tmp_path / "again" / name).read_bytes() == (dataset / name).read_bytes()


def test_odd_columns_are_told_in_one_line(tmp_path, dataset, machine):
    """Episodes that are not numbers, or too many; frames whose state is text."""
    path = dataset / "data/chunk-000/file-000.parquet"
    frames = polars.read_parquet(path)
    n = MAXIMUM_EPISODES + 1
    for content, reason in (
        (frames.with_columns(episode_index=polars.concat_list("episode_index")), "not a readable table"),
        (polars.DataFrame({"episode_index": range(n)}), "holds more than 100000 episodes"),
        (
            frames.with_columns(polars.lit("x").alias("action")),
            r"file-000\.parquet: feature action holds \w+, not numbers",
        ),
        (frames.drop("action"), "column action is missing"),
    ):
        content.write_parquet(path)
        with pytest.raises(InputError, match=reason):
            read_log(find_logs(dataset)[0], machine)
    episodes = dataset / "meta/episodes/chunk-000/file-000.parquet"
    polars.read_parquet(episodes).with_columns(length=polars.col("tasks")).write_parquet(episodes)
    frames.write_parquet(path)
    assert len(read_log(find_logs(dataset)[0], machine).q) == len(
        frames.filter(polars.col("episode_index") == 0)
    )


def test_what_lies_in_a_dataset_or_beside_a_stray_description_is_read_too(
    tmp_path, dataset, machine, config, loop_tracker
):
    session = make_session(machine, seconds=6)
    session.write(dataset / "data" / "morning", machine)
    session.write(dataset / "evening", machine)
    for text in ('{"codebase_version": "v3.0"}', '{"codebase_version": "v3.0", "fps": 20, "features": {}}'):
        stray = tmp_path / "data" / str(len(text))
        session.write(stray / "bag", machine)
        (stray / "meta").mkdir()
        (stray / "meta/info.json").write_text(text)
    summary = ingest(machine, tmp_path / "data", tmp_path / "tuples", config, loop_tracker)
    assert sum(report.name.endswith("bag") for report in summary.reports) == 2
    assert {"morning", "evening", "arm_episode_000000"} < {report.name for report in summary.reports}
    reasons = [failure.reason for failure in summary.failures]
    assert "info.json: not a LeRobot dataset's description" in reasons[0]
    assert "a LeRobot dataset without frames" in reasons[1]


@pytest.mark.parametrize(
    ("key", "stated", "told"),
    [
        ("total_episodes", 5, "states total_episodes 5, and 3"),
        ("total_frames", 7, "states total_frames 7, and"),
    ],
)
def test_totals_are_held_against_what_was_read(dataset, machine, key, stated, told):
    information = json.loads((dataset / "meta/info.json").read_text())
    (dataset / "meta/info.json").write_text(json.dumps({**information, key: stated}))
    (note,) = find_logs(dataset)[0].notes
    assert told in note.text
    assert any(told in other.text for other in read_log(find_logs(dataset)[0], machine).notes)


def test_channels(dataset, machine):
    path = dataset / "data/chunk-000/file-000.parquet"
    polars.read_parquet(path).with_columns(oil=polars.lit([40.0, 41.0])).write_parquet(path)
    information = json.loads((dataset / "meta/info.json").read_text())
    information["features"]["oil"] = {"dtype": "float64", "shape": [2], "names": ["in", "out"]}
    (dataset / "meta/info.json").write_text(json.dumps(information))
    channels = [ChannelSource("oil", column="oil.out"), ChannelSource("water", column="water")]
    raw = read_log(find_logs(dataset)[1], replace(machine, channels=channels))
    assert set(raw.channels["oil"].value) == {41.0} and len(raw.channels["oil"].time_ns) == len(raw.q)
    (note,) = raw.notes
    assert note.text.startswith("channel water: no feature `water`; the dataset has")
    polars.read_parquet(path).with_columns(oil=polars.lit("warm")).write_parquet(path)
    raw = read_log(find_logs(dataset)[1], replace(machine, channels=channels[:1]))
    assert len(raw.q) and not raw.channels and "channel_oil: feature oil holds" in raw.notes[0].text


@pytest.mark.parametrize("kind", [polars.Datetime("ns"), polars.Float64])
def test_stamps_of_another_type_are_told(dataset, machine, kind):
    path = dataset / "data/chunk-000/file-000.parquet"
    polars.read_parquet(path).with_columns(polars.col("stamp").cast(kind)).write_parquet(path)
    raw = read_log(find_logs(dataset)[0], machine)
    assert (
        raw.joint_stamp_ns[0] == 0
        and "holds" in raw.notes[0].text
        and "timed by their number" in raw.notes[0].text
    )
    assert describe(dataset).streams and not describe(dataset).failures


def test_a_row_group_of_many_episodes_is_read_once(dataset, machine, trajectories, monkeypatch):
    """Also where frames of episodes are mixed."""
    path = dataset / "data/chunk-000/file-000.parquet"
    polars.read_parquet(path).sort("frame_index", maintain_order=True).write_parquet(path)
    n_read, iter_batches = [], pq.ParquetFile.iter_batches

    def counted(self, *args, **kwargs):
        n_read.append(kwargs["columns"])
        return iter_batches(self, *args, **kwargs)

    entries = find_logs(dataset)
    monkeypatch.setattr(pq.ParquetFile, "iter_batches", counted)
    for entry, other in zip(entries, trajectories, strict=True):
        np.testing.assert_array_equal(read_log(entry, machine).command, other.a)
    assert len(n_read) == 1
    monkeypatch.setattr(frames, "KEPT_BYTES", 0)
    frames._kept.cache_clear()
    for entry, other in zip(entries, trajectories, strict=True):
        np.testing.assert_array_equal(read_log(entry, machine).command, other.a)
