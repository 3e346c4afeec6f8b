"""The rows of the benchmark of repairs, from stages that are stood in for by what they write."""

import argparse
import hashlib
import json
import subprocess
from pathlib import Path

import pytest

from benchmarks.repair_effects import Case, restored
from pipeline.control.policy import META_FILE, POLICY_FILE
from pipeline.control.repair.files import DOCUMENT, NEW

ON_MACHINE = {"sr_before": 0.6, "sr_after": 0.9, "oow_before": 0.4, "oow_after": 0.1}
RATES = {"repair": 0.9, "apg": 1.0}  # of the policy, by the stage that learned it


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the stages, in the order that they were started in."""
    names: list[str] = []

    def run(command: list[str], check: bool) -> None:
        stage = command[2].rpartition(".")[2]
        output = Path(command[3].partition("=")[2])
        names.append(stage)
        if stage == "close_loop":
            (output / "model_after").mkdir(parents=True)
            (output / "model_after/effects.json").write_text("{}")
        elif stage == "prove":
            (repair,) = (Path(each.partition("=")[2]) for each in command if each.startswith("repair="))
            learned = (repair / NEW / POLICY_FILE).read_text()
            document = json.loads((repair / DOCUMENT).read_text())
            assert document["policies"][NEW] == hashlib.sha256(learned.encode()).hexdigest()
            shown = {"on_machine": {**ON_MACHINE, "sr_after": RATES[learned]}, "promotable": True}
            (repair / DOCUMENT).write_text(json.dumps(document | shown))
        elif stage in ("repair", "apg"):
            policy = output / NEW if stage == "repair" else output
            policy.mkdir(parents=True)
            for name in (POLICY_FILE, META_FILE):
                (policy / name).write_text(stage)
            digest = hashlib.sha256(stage.encode()).hexdigest()
            (output / DOCUMENT).write_text(json.dumps({"policies": {NEW: digest}}))
        else:
            output.mkdir(exist_ok=True)

    monkeypatch.setattr(subprocess, "run", run)
    return names


def case_in(folder: Path) -> Case:
    given = argparse.Namespace(
        nominal="n", model="m", policy="p", output=folder, targets=10, profile="default"
    )
    return Case(given, "delay:3", 0)


def test_a_row_holds_before_after_and_anew_and_is_made_once(tmp_path: Path, started: list[str]) -> None:
    row = case_in(tmp_path).row()
    assert (row["before"], row["after"], row["anew"]) == (0.6, 0.9, 1.0)
    assert restored(row) == pytest.approx(0.75)
    assert started[:4] == ["record_changed", "close_loop", "repair", "prove"]
    assert started[-2:] == ["apg", "prove"]
    n_started = len(started)
    assert case_in(tmp_path).row() == row
    assert len(started) == n_started
