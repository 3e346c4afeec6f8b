"""The tutorial from its first command to its last, as the page has them, on minutes of logs and with tiny networks."""

import importlib
import json
import math
import re
from pathlib import Path

import pytest

from pipeline.discrepancy.families.uncorrectable import WITHOUT_WRAPPER
from pipeline.effects.catalogue import KNOWN
from tests.test_docs import STAGE_COMMANDS

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/tutorial.md"
COMMANDS = [
    (command.words[2].removeprefix("pipeline.stages."), list(command.words[3:]))
    for command in STAGE_COMMANDS
    if command.page == PAGE.name
]
TRIED = {"gain", "delay", "lag"}  # of all families
EXCLUDED = [family for family in (*KNOWN, *WITHOUT_WRAPPER) if family not in TRIED]
# Appended to what the page says, so that the whole takes seconds of processor time; what they are does not matter.
SMALLEST = {
    "record": ["record.session_minutes=[2,2]", "record.held_out_minutes=0.7"],
    "record_changed": ["record_changed.session_minutes=[1.5,1.5]"],
    "identify": [
        "identify.selected.mlp_dqdot.hidden=[8]",
        "identify.selected.mlp_dqdot.maximum_epochs=2",
        "identify.evaluation_windows=4",
    ],
    "judge": [
        "judge.narx={motion_lags:[0,1],command_lags:[0,1],maximum_terms:4,maximum_rows:500}",
        "judge.grey_box={grid_points:3,refinements:0}",
        "judge.growth={horizon:80,resamples:10}",
        "judge.extrapolation={configurations:1,steps:80}",
        "judge.long_prediction_steps=100",
    ],
    "close_loop": [
        "identify.selected.nfir_dqdot={hidden:[8],maximum_epochs:2,ensemble:{members:2,hidden:[8]}}",
        "identify.evaluation_windows=4",
        f"close_loop.exclude=[{','.join(EXCLUDED)}]",
        "close_loop.baselines_budget={batches_per_epoch:1,maximum_epochs:1,evaluation_windows:4}",
    ],
}


@pytest.mark.slow
@pytest.mark.long
def test_the_tutorial_from_end_to_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In one process: the commands' own processes would import JAX eight times."""
    monkeypatch.chdir(tmp_path)
    for stage, overrides in COMMANDS:
        words = [stage, *overrides, *SMALLEST.get(stage, []), "tracking=none"]
        monkeypatch.setattr("sys.argv", words)
        importlib.import_module(f"pipeline.stages.{stage}").main()

    page = PAGE.read_text(encoding="utf-8")
    for named in set(re.findall(r"`(tutorial/[^`]+)`", page)):
        assert Path(named).exists(), named
    errors = json.loads(Path("tutorial/loop/closed_loop.json").read_text())["error"]["open_loop_rmse_80"]
    assert all(math.isfinite(value) and value > 0 for when in errors.values() for value in when.values())
    assert json.loads(Path("tutorial/loop/closed_loop.json").read_text())["verdict"]
    judgement = json.loads(Path("tutorial/judgement.json").read_text())
    assert judgement["truth"][0].startswith("gain on swing")  # what the page says that the seal holds


def test_the_page_has_the_commands() -> None:
    assert len(COMMANDS) == 8  # as it promises
