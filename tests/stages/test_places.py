"""What a stage was given to read, and what it did not write, outlives its run."""

from pathlib import Path

import pytest

from pipeline.errors import InputError
from pipeline.stages.run_graph import refuse_others_logs
from tests.stages.command import run_stage

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("place", ["logs/my_field_day", "simulated/my_field_day", "logs/targets"])
def test_run_graph_deletes_no_logs_of_ones_own(place: str, tmp_path: Path) -> None:
    bag = tmp_path / "out" / place / "day.mcap"
    bag.parent.mkdir(parents=True)
    bag.write_text("mine")
    refused = run_stage("run_graph", "model=none", "policy=none", "output=out", folder=tmp_path)
    assert refused.returncode == 2 and "holds logs that run_graph did not write" in refused.stderr
    assert bag.read_text() == "mine"


def test_run_graph_takes_an_earlier_runs_bags_for_its_own(tmp_path: Path) -> None:
    (tmp_path / "logs/targets").mkdir(parents=True)
    (tmp_path / "results.json").write_text("[]")
    refuse_others_logs(tmp_path)
    (tmp_path / "simulated/another").mkdir(parents=True)
    with pytest.raises(InputError, match="simulated: holds logs that run_graph did not write"):
        refuse_others_logs(tmp_path)
