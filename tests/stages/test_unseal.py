"""Stage `unseal` and its judgement, beside the benchmark's own scoring of the same cases."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks.closed_loop.comparison import Solution, compare
from benchmarks.closed_loop.truth import Onset, TrueEffect, Truth
from pipeline.plant import effects
from pipeline.plant.machines.simulated import simulated_machine
from pipeline.plant.sealed.seal import contents, write_seal
from pipeline.plant.sealed.verdict_judgement import judge_verdict
from tests.stages.command import run_stage


def true(family: str, joint: str, depends_on: str, onset_s: float | None = None) -> dict[str, Any]:
    """As a seal holds it."""
    return {
        "family": family,
        "kind": family,
        "joints": [joint],
        "depends_on": [depends_on],
        "parameters": {"added_delay": {"value": 0.15, "unit": "s"}},
        "cause": "for the test",
        "onset_s": onset_s,
    }


def told(family: str, *joints: str, depends_on: tuple[str, ...] = (), **more: Any) -> dict[str, Any]:
    """As `closed_loop.json` holds it."""
    effect = {"family": family, "joints": list(joints), "depends_on": list(depends_on), "parameters": {}}
    return effect | {"certain": True, "onset": None} | more


def document(
    verdict: str, *effects_told: dict[str, Any], alternatives: tuple[dict[str, Any], ...] = ()
) -> dict[str, Any]:
    detected = {"none": False, "unexcited": None}.get(verdict, True)
    return {
        "detected": detected,
        "verdict": verdict,
        "effects": list(effects_told),
        "alternatives": list(alternatives),
    }


DELAY, LAG = true("delay", "swing", "command:swing"), true("lag", "boom", "command:boom")
KINK = true("other", "boom", "position:arm")
ONSET = true("delay", "swing", "command:swing", onset_s=80.0)
LAG_TWIN = told("lag", "swing", equivalent=True)
# truth, document, (verdict right, family right, joints right)
CASES = {
    "nothing, and nothing found": ([], document("none"), (True, True, True)),
    "nothing, but a false alarm": ([], document("named", told("gain", "arm")), (False, False, False)),
    "nothing, logs that cannot tell": ([], document("unexcited"), (False, True, True)),
    "missed": ([DELAY], document("none"), (False, False, False)),
    "right": ([DELAY], document("named", told("delay", "swing")), (True, True, True)),
    "wrong family": ([DELAY], document("named", told("lag", "swing")), (False, False, True)),
    "wrong joint": ([DELAY], document("named", told("delay", "boom")), (False, True, False)),
    "a joint too many": ([DELAY], document("named", told("delay", "swing", "boom")), (False, True, False)),
    "not certain": (
        [DELAY],
        document("ambiguous", told("delay", "swing", certain=False), alternatives=(LAG_TWIN,)),
        (False, True, True),
    ),
    "a pair, in another order": (
        [DELAY, LAG],
        document("named", told("lag", "boom"), told("delay", "swing")),
        (True, True, True),
    ),
    "half of a pair": ([DELAY, LAG], document("named", told("lag", "boom")), (False, False, False)),
    "onset": (
        [ONSET],
        document("named", told("change_point", "swing", of="delay")),
        (True, True, True),
    ),
    "onset not seen": ([ONSET], document("named", told("delay", "swing")), (False, False, True)),
    "outside the catalogue": (
        [KINK],
        document("outside_catalogue", told("other", "boom", depends_on=("position:arm", "command:boom"))),
        (True, True, True),
    ),
    "outside, wrong dependence": (
        [KINK],
        document("outside_catalogue", told("other", "boom", depends_on=("position:boom",))),
        (False, False, True),
    ),
    "outside, one dependence too many": (
        [KINK],
        document("outside_catalogue", told("other", "boom", depends_on=("position:arm", "travel:boom"))),
        (False, False, True),
    ),
    "outside, but named": ([KINK], document("named", told("gain", "boom")), (False, False, True)),
}


@pytest.mark.parametrize("name", CASES)
def test_the_judgement(name: str) -> None:
    truth, said, expected = CASES[name]
    judgement = judge_verdict(truth, said)
    assert (judgement.verdict_right, judgement.family_right, judgement.joints_right) == expected
    assert len(judgement.truth) == len(truth) and len(judgement.said) == len(said["effects"])


@pytest.mark.parametrize("name", [name for name in CASES if CASES[name][0]])
def test_what_is_right_here_is_right_in_the_benchmark(name: str) -> None:
    """The benchmark counts hits and joints of true effects by rules of its own."""
    sealed, said, (right, _, joints_right) = CASES[name]
    onset = Onset("log", 80.0)
    truth = Truth(
        8,
        "plant",
        "delay",
        "same",
        4,
        tuple(
            TrueEffect(
                family="change_point" if effect["onset_s"] else effect["family"],
                of=effect["family"] if effect["onset_s"] else None,
                kind=effect["kind"],
                joints=tuple(effect["joints"]),
                depends_on=tuple(effect["depends_on"]),
                parameters=effect["parameters"],
                onset=onset if effect["onset_s"] else None,
                cause=effect["cause"],
                size=1.0,
            )
            for effect in sealed
        ),
    )
    outcome = compare("case", truth, Solution(0, 1.0, said, None))
    assert right == (all(outcome.hits) and outcome.joints[1:] == (0, 0))
    assert joints_right == (outcome.joints[1:] == (0, 0))
    assert not (right and outcome.wrong_name)


def test_the_truth_among_what_cannot_be_told_apart() -> None:
    twin = told("delay", "swing", equivalent=True)
    both = document("ambiguous", told("lag", "swing", certain=False), alternatives=(twin,))
    neither = document("ambiguous", told("lag", "swing", certain=False), alternatives=(LAG_TWIN,))
    assert judge_verdict([DELAY], both).among_equivalents
    assert not judge_verdict([DELAY], neither).among_equivalents


def unseal(folder: Path, *overrides: str) -> subprocess.CompletedProcess[str]:
    return run_stage("unseal", *overrides, folder=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A seal beside a folder of sessions, and a verdict about them that is right."""
    folder = tmp_path_factory.mktemp("unseal")
    (folder / "data/raw/changed/sessions").mkdir(parents=True)
    drawn = effects.draw("delay", 1, simulated_machine("bobcat_e10"), 1.0)
    write_seal(folder / "data/raw/changed/undeclared.seal", [drawn])
    (folder / "artifacts/close_loop").mkdir(parents=True)
    (sealed,) = contents([drawn])
    said = document("named", told(sealed["family"], *sealed["joints"]))
    (folder / "artifacts/close_loop/closed_loop.json").write_text(json.dumps(said))
    return folder


def test_a_right_verdict_is_called_right(folder: Path) -> None:
    result = unseal(folder, "measured=data/raw/changed/sessions")
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "unseal: right"
    judgement = json.loads((folder / "artifacts/close_loop/judgement.json").read_text())
    assert judgement["verdict_right"] and judgement["family_right"] and judgement["joints_right"]
    assert judgement["truth"][0].startswith("delay on ") and "added_delay" in judgement["truth"][0]


def test_of_own_logs_nobody_knows_the_truth(folder: Path) -> None:
    result = unseal(folder, "measured=mine", "seal=absent/undeclared.seal", "output=own.json")
    assert result.returncode == 0, result.stderr
    assert json.loads((folder / "own.json").read_text()) == {
        "note": "the logs in mine are your own: there is no seal to open"
    }


def test_a_verdict_that_is_not_there_is_one_line(folder: Path) -> None:
    result = unseal(folder, "closed_loop=nowhere.json")
    assert result.returncode == 2
    assert result.stderr.splitlines() == ["error: unseal: nowhere.json: no such file; run close_loop first"]


@pytest.mark.parametrize(
    "effects", [[{}], ["gain"], 3, [{"family": "gain", "parameters": {"speed_ratio": 2}}]]
)
def test_a_document_of_something_else_is_one_line(folder: Path, effects: object) -> None:
    (folder / "odd.json").write_text(json.dumps({"verdict": "named", "effects": effects}))
    result = unseal(folder, "closed_loop=odd.json", "output=odd_judgement.json")
    assert result.returncode == 2
    (line,) = result.stderr.splitlines()
    assert line.startswith("error: unseal: odd.json: is not what close_loop writes (")
    assert not (folder / "odd_judgement.json").exists()
