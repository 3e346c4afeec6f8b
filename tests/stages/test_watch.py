"""A state of `watch` in use: by the graph of another stage, and for several machines at once."""

import json
import re
import shutil
from pathlib import Path

import pytest

from pipeline.deployment.graph_logs.graph_topics import read_graph_topics
from pipeline.logs.formats.discovery.discover import find_logs
from tests.deployment.machines import bobcat
from tests.stages.command import run_stage
from tests.watch.two_joints import learn, write_session

ROOT = Path(__file__).parents[2]  # the file of delays is named from here

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def learned(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with nominal sessions, and the state that was learned of them."""
    root = tmp_path_factory.mktemp("watch")
    learn(root, bobcat())
    return root


def test_a_graph_with_a_state_tells_of_the_machine_in_its_bag(learned: Path, tmp_path: Path) -> None:
    keys = [f"watch_state={learned / 'state'}", "graph=simulated_time", "watch.live_every_s=10"]
    words = ["profile=smoke", "seconds=30", f"output={tmp_path / 'drive'}"]
    result = run_stage("teleoperate", *keys, *words, folder=ROOT)
    assert result.returncode == 0, result.stderr
    (entry,) = find_logs(tmp_path / "drive/logs")
    statuses = [status for _, told in read_graph_topics(entry).diagnostics for status in told.statuses]
    texts = [status.text for status in statuses if status.source == "machine_watch"]
    assert len(texts) > 25 and re.fullmatch(r"unestimated, . of 10 s of motion", texts[0])
    assert re.fullmatch(
        r"(healthy|unestimated), evidence .* of 20", texts[-1]
    )  # nominal logs are of no plant
    refused = run_stage("teleoperate", *keys, "seconds=1", f"output={tmp_path / 'other'}", folder=ROOT)
    assert refused.returncode != 0 and "run `watch` with this state first" in refused.stderr


def test_machines_are_watched_as_jobs_of_a_sweep(learned: Path, tmp_path: Path) -> None:
    for day, name in enumerate(("a", "b"), start=11):
        shutil.copytree(learned / "state", tmp_path / name / "state")
        write_session(tmp_path / name / "sessions", day, machine=bobcat())
    others = (f"{key}=${{sessions}}/../{key}" for key in ("state", "output"))
    words = [
        "-m",
        "sessions=a/sessions,b/sessions",
        *others,
        f"nominal={learned / 'nominal'}",
        "profile=smoke",
    ]
    result = run_stage("watch", *words, folder=tmp_path)
    assert result.returncode == 0, result.stderr
    for name, session in (("a", "day_011"), ("b", "day_012")):
        (found,) = json.loads((tmp_path / name / "output/watch.json").read_text())["sessions"]
        assert (found["name"], found["state"]) == (session, "healthy")
