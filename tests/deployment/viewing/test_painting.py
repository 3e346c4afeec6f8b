"""What is painted, as a reader that is not ours finds it in a file."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from pipeline.configuration.load import load_section
from pipeline.deployment.settings import CoverageConfig
from pipeline.deployment.transports.mcap_file import write_mcap_file
from pipeline.deployment.viewing import painting
from pipeline.deployment.viewing.coverage import Coverage, ReachableCells
from pipeline.deployment.viewing.painting import Painting, painted_topics, pitch_colours
from pipeline.deployment.viewing.ros_messages import STORE
from pipeline.logs.messages.raw_log import RawLog
from tests.deployment.machines import MIDDLE, arm, bobcat

BEGIN_NS = 1_775_000_000_000_000_000


@cache
def reachable() -> ReachableCells:
    return ReachableCells(bobcat(), arm(), load_section("coverage", CoverageConfig))


def log_of(q: np.ndarray, period_ns: int) -> RawLog:
    time_ns = BEGIN_NS + period_ns * np.arange(len(q))
    return RawLog("bag", Path(), time_ns, time_ns, q, time_ns[:1], 0 * q[:1], None)


def read_back(log: RawLog, path: Path) -> dict[str, list]:
    write_mcap_file(path, STORE, painted_topics(log, reachable()))
    found: dict[str, list] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def fields(cloud) -> dict[str, np.ndarray]:
    kinds = {6: "<u4", 7: "<f4"}  # of sensor_msgs/PointField
    table = np.dtype([(field.name, kinds[field.datatype]) for field in cloud.fields])
    assert cloud.point_step == table.itemsize
    columns = np.frombuffer(bytes(cloud.data), table)
    return {name: columns[name] for name in columns.dtype.names}


def test_the_history_grows_second_by_second_with_its_share(tmp_path: Path) -> None:
    steps = np.linspace(0.0, 0.8, 51)[:, None]  # 2.5 s, from inwards to outwards
    q = MIDDLE + steps * np.array([0.3, -0.5, 0.6, 1.0])
    found = read_back(log_of(q, 50_000_000), tmp_path / "view.mcap")
    assert {topic: len(messages) for topic, messages in found.items()} == dict.fromkeys(
        ("/painted", "/painted_share", "/painting", "/paint_next"), 3
    )
    position, pitch = arm().forward(q).position, arm().pitch(q)
    for second, n in enumerate((20, 40, 51)):
        painted, coverage = fields(found["/painted"][second][1]), Coverage(reachable())
        assert found["/painted"][second][0] == BEGIN_NS + (n - 1) * 50_000_000
        tips = np.stack([painted[axis] for axis in "xyz"], axis=1)
        apart = np.linalg.norm(position[:n, None] - tips, axis=-1)
        assert apart.min(axis=0).max() < 1e-6 and apart.min(axis=1).max() < 0.04  # a line without gaps
        np.testing.assert_allclose(painted["pitch"], pitch[apart.argmin(axis=0)], atol=1e-6)
        share = np.minimum(np.abs(painted["pitch"]) / 1.047, 1.0)
        red = 255.0 - share * np.where(painted["pitch"] < 0, 255 - 86, 255 - 213)
        np.testing.assert_allclose(painted["rgb"] >> 16, red, atol=0.51)
        coverage.add(q[:n])
        assert found["/painted_share"][second][1].data == coverage.share > 0
        said = found["/painting"][second][1].data.splitlines()
        assert said[0].startswith(f"painted {100 * coverage.share:.1f} % of what can be reached of W+: ")
        assert f": {coverage.n_visited} of {coverage.n_reachable} cells" in said[0] and len(said) == 4
        (nearest,) = coverage.nearest(q[n - 1], 1)
        mark = np.stack([fields(found["/paint_next"][second][1])[axis] for axis in "xyz"], axis=1)
        assert np.linalg.norm(mark - arm().forward(nearest).position, axis=1).min() < 1e-6
        assert f"pitch {arm().pitch(nearest):+.2f} rad" in said[1]


def test_a_long_log_has_a_hundred_messages_and_a_standing_arm_one_point(tmp_path: Path) -> None:
    q = np.repeat(MIDDLE[None], 2000, axis=0)
    found = read_back(log_of(q, 500_000_000), tmp_path / "view.mcap")
    assert 100 <= len(found["/painted"]) <= 101
    assert found["/painted"][-1][0] == BEGIN_NS + 1999 * 500_000_000
    assert found["/painted"][-1][1].width == 1


def test_the_history_of_a_shift_is_thinned_and_its_coverage_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(painting, "MOST_POINTS", 10)
    q = MIDDLE + np.linspace(0.0, 0.5, 40)[:, None] * np.array([1.0, 0.0, 0.0, 0.0])
    shift, coverage = Painting(reachable()), Coverage(reachable())
    for row in q:
        shift.add(row[None])
        coverage.add(row[None])
    topics = {topic.name: topic.messages[0][1] for topic in shift.topics(BEGIN_NS)}
    assert 5 <= topics["/painted"].width <= 10
    assert topics["/painted_share"].data == coverage.share


@pytest.mark.parametrize(
    ("pitch", "colour"),
    [(-2.0, 0x56B4E9), (-1.0, 0x56B4E9), (0.0, 0xFFFFFF), (1.0, 0xD55E00), (9.0, 0xD55E00)],
)
def test_pitch_has_a_colour_of_its_own(pitch: float, colour: int) -> None:
    found = pitch_colours(np.array([pitch]), 1.0)
    assert found["rgb"].tolist() == [colour] and found["colors"].tolist() == [colour * 256 + 255]
