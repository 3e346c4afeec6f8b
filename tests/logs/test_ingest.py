import json
import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import polars
import pytest

from pipeline.errors import InputError
from pipeline.logs import ingest as ingest_module
from pipeline.logs.ingest import ingest, write_metrics
from pipeline.logs.tracked_velocities import track
from pipeline.logs.trajectories import load_trajectories
from pipeline.logs.tuples import read_tuples
from tests.logs.conftest import REPOSITORY, load_machine, make_session, shared_folder


@pytest.fixture
def folder(tmp_path, machine):
    for number in range(3):
        make_session(machine, seconds=15, seed=number).write(tmp_path / "logs" / f"bag{number}", machine)
    return tmp_path / "logs"


@pytest.fixture
def run(machine, config, loop_tracker, folder, tmp_path):
    return lambda **options: ingest(machine, folder, tmp_path / "tuples", config, loop_tracker, **options)


def contents(directory):
    return {path.name: path.read_bytes() for path in directory.iterdir()}


def test_one_file_per_bag_that_says_the_same_as_in_memory(
    run, folder, tmp_path, machine, config, loop_tracker
):
    summary = run()
    assert [report.name for report in summary.reports] == ["bag0", "bag1", "bag2"] and not summary.failures
    expected = load_trajectories(folder, machine, config, loop_tracker)
    for one, other in zip(read_tuples(tmp_path / "tuples", machine), expected, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.q, other.q)
        np.testing.assert_array_equal(one.qd, track(other.q, 0.05, loop_tracker))
        np.testing.assert_array_equal(one.a, other.a)


def test_second_run_reads_nothing_and_changes_nothing(run, folder, tmp_path, monkeypatch):
    first = run()
    before = contents(tmp_path / "tuples")
    monkeypatch.setattr(ingest_module, "read_log", lambda *_: pytest.fail("a log was read again"))
    second = run()
    assert second.n_skipped == 3 and second.metrics() == first.metrics()
    assert contents(tmp_path / "tuples") == before


def test_resumes_only_what_is_missing_or_changed(run, folder, tmp_path, machine, config, loop_tracker):
    run()
    before = contents(tmp_path / "tuples")
    (tmp_path / "tuples" / "bag1.parquet").write_bytes(b"half written")
    assert run().n_skipped == 2
    assert contents(tmp_path / "tuples") == before
    os.rename(folder / "bag2", tmp_path / "gone")
    make_session(machine, seconds=15, seed=9).write(folder / "bag3", machine)
    assert run().n_skipped == 2
    assert sorted(contents(tmp_path / "tuples")) == sorted(
        f"bag{n}{suffix}" for n in (0, 1, 3) for suffix in (".parquet", ".ingest.json")
    )
    changed = type(config)(**{**vars(config), "validation_fraction": 0.2})
    assert ingest(machine, folder, tmp_path / "tuples", changed, loop_tracker).n_skipped == 0


def test_failing_log_does_not_stop_the_others(run, folder, tmp_path):
    (folder / "broken.bag").write_bytes(b"#ROSBAG V1.2\n")
    (folder / "bag1" / "bag1_0.mcap").write_bytes(b"")
    summary = run()
    assert [report.name for report in summary.reports] == ["bag0", "bag2"]
    assert [failure.name for failure in summary.failures] == ["bag1", "broken"]
    assert summary.metrics()["n_failed"] == 2
    with pytest.raises(
        InputError, match=r"2 of 4 logs failed: .*bag1_0.mcap: not an MCAP file.*another version"
    ):
        summary.raise_if_failed()
    assert not (tmp_path / "tuples" / "bag1.parquet").exists()


def test_side_by_side_gives_the_same_bytes(run, machine, folder, tmp_path, config, loop_tracker, monkeypatch):
    run()
    monkeypatch.setattr(ingest_module, "PARALLEL_FROM_BYTES", 0)
    ingest(machine, folder, tmp_path / "parallel", config, loop_tracker, n_processes=2)
    assert contents(tmp_path / "parallel") == contents(tmp_path / "tuples")


def test_full_disk_fails_in_one_line(run, tmp_path):
    """The kernel refuses to let files grow beyond 10 kB, as it refuses on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        summary = run()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert len(summary.failures) == 3 and not summary.reports
    assert ".bag0.scratch: cannot be written (File too large); make room" in summary.failures[0].reason
    assert list((tmp_path / "tuples").iterdir()) == []


def test_what_a_killed_run_left_is_removed_and_nothing_else(run, tmp_path):
    run()
    before = contents(tmp_path / "tuples")
    own = tmp_path / "tuples" / "own.parquet"
    polars.DataFrame({"trajectory": ["x"], "value": [1.0]}).write_parquet(own)
    (tmp_path / "tuples" / "gone.parquet").write_bytes(before["bag0.parquet"])  # killed before the record
    (tmp_path / "tuples" / ".bag1.parquet.77.partial").write_bytes(b"half")
    (tmp_path / "tuples" / ".gone.scratch").mkdir()
    assert run().n_skipped == 3
    own.unlink()
    assert contents(tmp_path / "tuples") == before


def test_output_among_the_logs(machine, config, loop_tracker, folder):
    """Its tuples are not logs; the very folder of the logs is refused."""
    for n_skipped in (0, 3):
        summary = ingest(machine, folder, folder / "tuples", config, loop_tracker)
        assert summary.n_skipped == n_skipped and len(summary.reports) == 3 and not summary.failures
    with pytest.raises(InputError, match="is the folder of the logs"):
        ingest(machine, folder, folder, config, loop_tracker)


def test_logs_in_a_folder_of_the_output(machine, config, loop_tracker, folder, monkeypatch):
    """`cd case; ingest logs=logs output=.`, also where one log is named, or one that lies in the output itself."""
    monkeypatch.chdir(folder.parent)
    shutil.copy("logs/bag0/bag0_0.mcap", "alone.mcap")
    Path(".bag9.partial").mkdir()  # a bag that is being recorded
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    for logs, names in (
        ("logs", ["bag0", "bag1", "bag2"]),
        ("logs", ["bag0", "bag1", "bag2"]),
        ("logs/bag1", ["bag1"]),
        ("alone.mcap", ["alone"]),
    ):
        summary = ingest(machine, Path(logs), Path(), config, loop_tracker)
        assert [report.name for report in summary.reports] == names and not summary.failures
        assert sorted(path.stem for path in Path().glob("*.parquet")) == names
        assert all(path.read_bytes() == content for path, content in before.items())
    assert Path(".bag9.partial").is_dir()


def test_logs_where_the_output_has_its_tuples_are_refused(machine, config, loop_tracker, folder, tmp_path):
    """They would be written over, or removed as tuples of a log that is gone."""
    output = tmp_path / "out"
    ingest(machine, folder, output, config, loop_tracker)
    (output / "link.parquet").symlink_to(shutil.copy(output / "bag1.parquet", tmp_path / "bag1.parquet"))
    polars.DataFrame({"mine": [1.0]}).write_parquet(
        output / "table.parquet"
    )  # its tuples would have its name
    (output / ".day.scratch").mkdir()
    shutil.copy(folder / "bag0/bag0_0.mcap", output / ".day.scratch/day.mcap")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    for logs in ("out/bag0.parquet", "out/link.parquet", "out/table.parquet", "out/.day.scratch", "."):
        with pytest.raises(InputError, match=r"lies where the output .* has its tuples; move the logs"):
            ingest(machine, tmp_path / logs, output, config, loop_tracker)
        assert all(path.read_bytes() == content for path, content in before.items())


def test_an_earlier_runs_tuples_are_no_logs(machine, config, loop_tracker, folder, tmp_path):
    ingest(machine, folder, tmp_path / "out", config, loop_tracker)
    before = contents(tmp_path / "out")
    shutil.rmtree(folder)
    with pytest.raises(InputError, match="holds no logs but tuples in the output"):
        ingest(machine, tmp_path, tmp_path / "out", config, loop_tracker)
    assert contents(tmp_path / "out") == before


def test_empty_folder(tmp_path, machine, config, loop_tracker):
    (tmp_path / "none").mkdir()
    with pytest.raises(InputError, match="none: holds no logs"):
        ingest(machine, tmp_path / "none", tmp_path / "out", config, loop_tracker)
    summary = ingest(machine, tmp_path / "none", tmp_path / "out", config, loop_tracker, allow_empty=True)
    assert summary.metrics()["n_logs"] == 0


def test_metrics_are_flat_finite_and_without_paths(run, folder, tmp_path):
    summary = run()
    write_metrics(summary, tmp_path / "quality.json")
    metrics = json.loads((tmp_path / "quality.json").read_text())
    assert all(value is None or isinstance(value, (int, float)) for value in metrics.values())
    assert metrics["n_logs"] == 3 and metrics["bag0/joint_states/rate_hz"] == pytest.approx(50, rel=0.02)
    assert metrics["bag0/clock/offset_s"] == pytest.approx(0.0018, abs=2e-4)
    record = (tmp_path / "tuples" / "bag0.ingest.json").read_text()
    assert str(tmp_path) not in record + json.dumps(metrics)


@pytest.mark.parametrize("case", ["p1", "p2", "p3"])
def test_practice_bags(tmp_path, case, machine, config, loop_tracker):
    """Permuted and additional joint names, jittered stamps: one trajectory each, 20 Hz, commands of the set."""
    folder = shared_folder("practice", case, "nominal")
    summary = ingest(machine, folder, tmp_path, config, loop_tracker)
    assert not summary.failures
    for trajectory in read_tuples(tmp_path, machine):
        assert "#" not in trajectory.name and len(trajectory) > 4000
        assert set(np.unique(trajectory.a)) == {-1.0, 0.0, 1.0}
        assert (np.diff(trajectory.stamp_ns) == 50_000_000).all()
        inside = (trajectory.q > machine.lower - 0.01) & (trajectory.q < machine.upper + 0.01)
        assert inside.all()
    for report in summary.reports:
        assert 0.0008 < report.metrics["clock/offset_s"] < 0.0028
        assert all(0.1 < report.metrics[f"{joint}/apparent_delay_s"] < 0.8 for joint in machine.joint_names)


def test_measured_excavator(tmp_path, config, loop_tracker):
    machine = load_machine("rc_excavator")
    summary = ingest(machine, shared_folder("measured", "nominal"), tmp_path, config, loop_tracker)
    assert not summary.failures and len(summary.reports) == 7
    metrics = summary.metrics()
    assert metrics["n_trajectories"] == 8  # one log has a gap of 0.503 s
    assert 18 * 60 < metrics["duration_s"] < 20 * 60
    frame = polars.read_parquet(tmp_path / "manual_orlando_1102_1405.parquet")
    assert frame["trajectory"].unique(maintain_order=True).to_list() == [
        "manual_orlando_1102_1405",
        "manual_orlando_1102_1405#1",
    ]


PEAK_OF_INGEST = """
import sys
from pathlib import Path
from pipeline.logs.ingest import ingest
from pipeline.configuration.load import load_machine, load_section
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig

config, tracker = load_section("ingest", IngestConfig), load_section("control.loop_tracker", LoopTrackerConfig)
ingest(load_machine("bobcat_e10"), Path(sys.argv[1]), Path(sys.argv[2]), config, tracker)
print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])
"""


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs Linux's /proc to read peak memory")
def test_memory_does_not_grow_with_the_bag(tmp_path, machine):
    """An hour more takes no more memory, but for what an allocator keeps (it is 50 MiB).

    Both bags are long enough for the tracker's compiler, which takes memory itself.
    """
    peak_mebibytes = []
    for minutes in (50, 110):
        bag = make_session(machine, seconds=60 * minutes).write(tmp_path / f"bag{minutes}", machine)
        command = [sys.executable, "-c", PEAK_OF_INGEST, bag, tmp_path / f"out{minutes}"]
        found = subprocess.run(command, cwd=REPOSITORY, check=True, capture_output=True, text=True)
        peak_mebibytes.append(int(found.stdout) / 1024)
    assert peak_mebibytes[1] - peak_mebibytes[0] < 20, peak_mebibytes
