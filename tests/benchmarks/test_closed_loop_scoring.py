"""The blind benchmark's scoring on solutions and truths made by hand, with figures reckoned by hand."""

import json
import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.closed_loop import blind, kinds
from benchmarks.closed_loop.comparison import Solution, compare
from benchmarks.closed_loop.dependence import Dependence, judge_dependence
from benchmarks.closed_loop.folders import CONFIGURATION, Folders, sealed
from benchmarks.closed_loop.goals import figures, roc
from benchmarks.closed_loop.intervals import clopper_pearson, over_machines, share_interval
from benchmarks.closed_loop.ledger import Record, add, fingerprint, read
from benchmarks.closed_loop.losing_step import NOT_FIRST
from benchmarks.closed_loop.parameter_errors import NAMES, parameter_errors, sign_is_right
from benchmarks.closed_loop.score import outcomes, records, report
from benchmarks.closed_loop.sessions import machine
from benchmarks.closed_loop.simulators import PLANT
from benchmarks.closed_loop.solve import LOG_FILE, RUN_FILE, TIMED_OUT, is_solved, run, tasks
from benchmarks.closed_loop.truth import Onset, TrueEffect, Truth
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification
from pipeline.plant import effects

FLOOR = dict.fromkeys(("swing", "boom", "arm", "bucket"), 0.01)


def true_effect(family, joints, parameters=None, depends_on=(), of=None, onset=None, visible_size=0.5):
    stated = {name: {"value": value, "unit": "?"} for name, value in (parameters or {}).items()}
    return TrueEffect(
        family, of, of or family, tuple(joints), tuple(depends_on), stated, onset, "test", 1.0, visible_size
    )


def truth_of(*true, kind="delay", number=8):
    return Truth(number, "plant", kind, "same", 4, tuple(true))


def reported(family, joints, parameters=None, certain=True, **more):
    numbers = {
        name: {"value": value, "unit": "?", "ci95": list(interval)}
        for name, (value, interval) in (parameters or {}).items()
    }
    return {"family": family, "joints": joints, "parameters": numbers, "certain": certain} | more


def answer(*found, verdict="named", alternatives=(), after=None, blackbox=None):
    return {
        "detected": bool(found),
        "verdict": verdict,
        "effects": list(found),
        "alternatives": list(alternatives),
        "error": {"open_loop_rmse_80": {"before": {}, "after": after or {}}},
        "baselines": {
            "blackbox_residual": {"open_loop_rmse_80": blackbox or {}},
            "nominal_floor": {"open_loop_rmse_80": FLOOR},
        },
    }


def scored(truth, given, exam=None, seconds=10.0, status=0):
    return compare("case", truth, Solution(status, seconds, given, exam))


DELAY = truth_of(true_effect("delay", ["swing"], {"added_delay": 0.2}))


def test_a_right_answer_counts_as_such_with_its_numbers():
    given = answer(
        reported("delay", ["swing", "arm"], {"added_delay": (0.19, (0.17, 0.21))}),
        after={"swing": 0.020, "arm": 0.5},
        blackbox={"swing": 0.025, "arm": 0.1},
    )
    exam = {"before": FLOOR | {"swing": 0.05}, "after": FLOOR | {"swing": 0.02}}
    outcome = scored(DELAY, given, exam)
    assert (outcome.detected, outcome.hits, outcome.wrong_name) == (True, (True,), False)
    assert outcome.joints == (1, 1, 0)
    [parameter] = outcome.parameters
    assert parameter.relative == pytest.approx(0.05)
    assert parameter.covered
    assert outcome.reduction == pytest.approx(0.6)
    assert outcome.avoided == pytest.approx((0.05**2 - 0.02**2) / (0.05**2 - 0.01**2))
    assert outcome.beats == {"blackbox_residual": True}  # on swing; the other was not fitted


def test_a_certain_wrong_family_is_a_wrong_name_an_uncertain_one_and_other_are_not():
    assert scored(DELAY, answer(reported("lag", ["swing"]))).wrong_name
    assert not scored(DELAY, answer(reported("lag", ["swing"], certain=False))).wrong_name
    other = scored(DELAY, answer(reported("other", ["swing"]), verdict="outside_catalogue"))
    assert not other.wrong_name
    assert other.hits == (False,)
    right_and_more = scored(DELAY, answer(reported("delay", ["swing"]), reported("gain", ["arm"])))
    assert right_and_more.wrong_name
    assert right_and_more.hits == (True,)


def test_the_right_family_on_another_joint_is_no_hit_and_a_wrong_name():
    elsewhere = scored(DELAY, answer(reported("delay", ["arm"])))
    assert (elsewhere.hits, elsewhere.wrong_name) == ((False,), True)
    also = scored(DELAY, answer(reported("delay", ["swing", "arm"])))
    assert (also.hits, also.wrong_name) == ((True,), False)
    twin = {"family": "delay", "joints": ["arm"], "equivalent": True}
    unsure = answer(reported("lag", ["swing"], certain=False), verdict="ambiguous", alternatives=[twin])
    assert scored(DELAY, unsure).half_hits == 0


def test_the_truth_among_equivalent_explanations_is_half_right():
    first = reported("lag", ["swing"], certain=False)
    given = answer(first, verdict="ambiguous", alternatives=[{"family": "delay", "equivalent": True}])
    outcome = scored(DELAY, given)
    assert (outcome.hits, outcome.half_hits) == ((False,), 1)
    lost = answer(first, verdict="ambiguous", alternatives=[{"family": "delay"}])
    assert scored(DELAY, lost).half_hits == 0
    itself = answer(reported("delay", ["swing"], certain=False), verdict="ambiguous")
    assert (scored(DELAY, itself).hits, scored(DELAY, itself).half_hits) == ((False,), 1)


def test_pairs_count_twice_in_any_order():
    pair = truth_of(true_effect("delay", ["swing"]), true_effect("gain", ["arm"]), kind="pair")
    both = answer(reported("gain", ["arm"]), reported("delay", ["swing"]))
    assert scored(pair, both).hits == (True, True)
    one = scored(pair, answer(reported("gain", ["arm"])))
    assert one.hits == (False, True)
    assert one.joints == (1, 0, 1)
    third = answer(reported("lag", ["boom"]), reported("gain", ["arm"]), reported("delay", ["swing"]))
    assert scored(pair, third).hits == (False, True)


def test_a_change_point_needs_its_family_and_gives_the_error_of_its_moment():
    truth = truth_of(
        true_effect("change_point", ["swing"], {"added_delay": 0.2}, of="delay", onset=Onset("bag", 100.0)),
        kind="change_point",
    )
    right = reported(
        "change_point",
        ["swing"],
        {"added_delay": (0.1, (0.0, 0.1))},
        of="delay",
        onset={"trajectory": "bag", "t": 103.0},
    )
    outcome = scored(truth, answer(right))
    assert outcome.hits == (True,)
    assert outcome.onset_error_s == pytest.approx(3.0)
    assert outcome.parameters[0].relative == pytest.approx(0.5)
    assert not outcome.parameters[0].covered
    elsewhere = right | {"onset": {"trajectory": "another", "t": 100.0}}
    assert scored(truth, answer(elsewhere)).onset_error_s == math.inf
    assert scored(truth, answer()).onset_error_s == math.inf
    assert scored(truth, answer(right | {"of": "lag"})).wrong_name
    assert scored(truth, answer(reported("delay", ["swing"]))).wrong_name


@pytest.mark.parametrize(
    ("told", "expected"),
    [
        (["command:arm"], Dependence.right),
        (["command:arm", "direction:boom", "command:boom", "direction:arm"], Dependence.right),
        (["command:arm", "position:arm"], Dependence.near),
        (["command"], Dependence.near),
        (["command:swing"], Dependence.near),
        (["command:boom"], Dependence.wrong),
        (["position:arm"], Dependence.wrong),
        ([], Dependence.wrong),
    ],
)
def test_dependence_names_the_truth_and_nothing_wrong(told, expected):
    assert judge_dependence(["command:arm"], told, ["boom"]) == expected


def test_other_is_right_by_its_dependence():
    truth = truth_of(true_effect("other", ["boom"], depends_on=["hold_time:boom"]), kind="coil_fade")
    right = answer(reported("other", ["boom"], depends_on=["hold_time:boom"]), verdict="outside_catalogue")
    wrong = answer(reported("other", ["boom"], depends_on=["position:boom"]), verdict="outside_catalogue")
    assert scored(truth, right).hits == (True,)
    assert scored(truth, wrong).hits == (False,)
    assert scored(truth, wrong).dependence == Dependence.wrong


def test_neutral_truths_are_compared_on_an_absolute_scale_and_signs_apart():
    truth = {"offset": {"value": 0.0}, "scale": {"value": 1.1}}
    told = {"offset": {"value": 0.013, "ci95": [-0.01, 0.03]}, "scale": {"value": 1.045, "ci95": [1.0, 1.05]}}
    offset, scale = parameter_errors("sensor_bias", truth, told)
    assert offset.relative == pytest.approx(0.2)
    assert offset.of_change is None
    assert offset.covered
    assert scale.relative == pytest.approx(0.05)
    assert scale.of_change == pytest.approx(0.55)
    assert not scale.covered
    fixed = told | {"offset": {"value": 0.0, "ci95": [0.0, 0.0]}}
    assert [error.name for error in parameter_errors("sensor_bias", truth, fixed)] == ["scale"]
    wrong = {"offset": {"value": 0.05}, "scale": {"value": 1.0}}
    missed, _ = parameter_errors("sensor_bias", wrong, {"offset": fixed["offset"]})
    assert (missed.name, missed.relative, missed.covered) == ("offset", 1.0, False)
    gain = {"speed_ratio": {"value": 0.8}, "direction": {"value": -1}}
    assert [error.name for error in parameter_errors("gain", gain, {})] == ["speed_ratio"]
    assert sign_is_right("gain", gain, {"direction": {"value": -1.0}})
    assert not sign_is_right("gain", gain, {"direction": {"value": 0}})
    assert sign_is_right("delay", {}, {}) is None


def test_every_family_states_the_contracts_parameters():
    assert set(NAMES) == set(kinds.FAMILIES)
    assert set(kinds.FAMILIES) | set(PLANT.outside) == set(effects.KINDS)


def test_a_ramp_is_right_as_a_change_point_or_a_dependence_on_time():
    onset = Onset("bag", 100.0)
    ramp = truth_of(true_effect("change_point", ["swing"], of="delay", onset=onset), kind="ramp")
    set_in = reported("change_point", ["swing"], of="delay", onset={"trajectory": "bag", "t": 130.0})
    over_time = reported("other", ["swing"], depends_on=["absolute_time"])
    warming = reported("thermal_drift", ["swing"], depends_on=["time_since_start"])
    for told in (set_in, over_time, warming):
        outcome = scored(ramp, answer(told))
        assert (outcome.hits, outcome.wrong_name) == ((True,), False)
    assert scored(ramp, answer(reported("delay", ["swing"], depends_on=["command:swing"]))).wrong_name
    assert scored(replace(ramp, kind="change_point"), answer(over_time)).hits == (False,)


def candidate(family, joint, **more):
    return {"family": family, "joint": joint, "share": 0.2} | more


@pytest.mark.parametrize(
    ("trace", "step"),
    [
        ({"screened": [], "chosen": []}, "not screened"),
        ({"screened": [candidate("delay", "arm")], "chosen": []}, "not screened"),  # on another joint
        ({"screened": [candidate("delay", "swing")], "chosen": []}, "not chosen"),
        (
            {"screened": [], "chosen": [candidate("delay", "swing", e_value=3.0, refused_at="confirmation")]},
            "refused at confirmation",
        ),
        ({"screened": [], "chosen": [candidate("delay", "swing", e_value=1e3, refused_at=None)]}, NOT_FIRST),
        (None, "no trace"),
    ],
)
def test_the_step_that_lost_an_effect_is_told(trace, step):
    outcome = scored(DELAY, answer(verdict="none") | {"trace": trace})
    assert outcome.lost == (step,)
    assert scored(DELAY, answer(reported("delay", ["swing"])) | {"trace": trace}).lost == (None,)


def test_a_dependence_is_lost_by_its_variable():
    truth = truth_of(true_effect("other", ["boom"], depends_on=["hold_time:boom"]), kind="coil_fade")
    for family, step in (("other:hold_time", "not chosen"), ("other:position", "not screened")):
        trace = {"screened": [candidate(family, "boom")], "chosen": []}
        assert scored(truth, answer(verdict="none") | {"trace": trace}).lost == (step,)
    assert scored(truth, None, status=2).lost == ("no answer",)


def with_e_value(given, e_value):
    return given | {
        "trace": {"screened": [], "chosen": [candidate("lag", "arm", e_value=e_value, refused_at=None)]}
    }


def test_goals_are_reckoned_over_the_right_cases():
    right = scored(DELAY, answer(reported("delay", ["swing"], {"added_delay": (0.22, (0.1, 0.3))})))
    missed = scored(DELAY, answer(verdict="none"))
    failed = scored(DELAY, None, status=2)
    small = scored(truth_of(true_effect("delay", ["swing"], visible_size=2.0)), answer(verdict="none"))
    quiet = scored(truth_of(kind="null"), answer(verdict="none"))
    alarm = scored(truth_of(kind="nominal_range"), answer(reported("gain", ["arm"])))
    everything = [right, missed, failed, small, quiet, alarm]
    visible, all_sizes = ({f.name: f for f in figures(everything, only)} for only in (True, False))
    assert (visible["detected"].value, visible["detected"].n) == (pytest.approx(1 / 3), 3)
    assert (all_sizes["detected"].value, all_sizes["detected"].n) == (0.25, 4)
    for found in (visible, all_sizes):
        assert (found["alarms without effect"].value, found["alarms without effect"].n) == (0.5, 2)
        assert found["parameters: relative error, median"].value == pytest.approx(0.1)
    assert visible["right family first"].value == pytest.approx(1 / 3)
    assert visible["joints, F1"].value == pytest.approx(2 * 1 / (2 * 1 + 0 + 2))
    assert visible["detected"].met is False
    assert "lower error than finetune" not in visible  # no baseline was fitted


def test_the_roc_is_over_the_evidence_of_null_cases():
    nulls = [
        scored(truth_of(kind="null"), with_e_value(answer(verdict="none"), b)) for b in (0.0, 0.1, 0.2, 0.3)
    ]
    found = [scored(DELAY, with_e_value(answer(verdict="none"), b)) for b in (0.05, 0.25, 0.35)]
    nothing_chosen = scored(DELAY, answer(verdict="none"))
    shares, area = roc([*nulls, *found, nothing_chosen], only_visible=True)
    assert shares[0] == 0.25  # above all nulls: one of four
    assert area == pytest.approx((1 + 3 + 4 + 0) / 16)


def test_intervals_are_over_machines():
    assert clopper_pearson(0, 60) == (0.0, pytest.approx(1.0 - 0.025 ** (1 / 60)))
    assert share_interval([[True]] * 20) == (pytest.approx(0.025 ** (1 / 20)), 1.0)
    assert share_interval([[True] * 5] * 20) == share_interval(
        [[True]] * 20
    )  # five of a machine are not five machines
    lower, upper = share_interval([[True] * 10, [False] * 10] * 10)
    assert upper - lower == pytest.approx(2 * 1.96 * 0.5 / math.sqrt(20), rel=0.15)
    lower, upper = over_machines([[value] for value in range(101)], lambda drawn: float(np.median(drawn)))
    assert lower == pytest.approx(50 - 1.25 * 1.96 * 29.2 / math.sqrt(101), abs=3) and upper > 54


@pytest.fixture
def root(tmp_path):
    """A root with one case of a delay, without bags."""
    folders = Folders(tmp_path)
    case = folders.cases / "abc"
    case.mkdir(parents=True)
    folders.complete("abc", machine())
    folders.seals.mkdir()
    (folders.seals / "abc.json").write_text(DELAY.to_json())
    return folders


READ = "import sys; print(open(sys.argv[1]).read())"


def run_blind(root, *command):
    return subprocess.run(
        [sys.executable, blind.__file__, str(root.seals), *command],
        capture_output=True,
        text=True,
        check=False,
    )


def test_the_solver_cannot_read_the_seals(root):
    with sealed(root.seals):
        tried = run_blind(root, sys.executable, "-c", READ, str(root.seals / "abc.json"))
        assert tried.returncode != 0
        assert "PermissionError" in tried.stderr
        [description] = (root.cases / "abc").rglob("*.yaml")
        allowed = run_blind(root, sys.executable, "-c", READ, str(description))
        assert allowed.returncode == 0
    assert "delay" in (root.seals / "abc.json").read_text()


def test_nothing_is_solved_while_the_seals_are_open(root):
    tried = run_blind(root, sys.executable, "-c", "print('started')")
    assert tried.returncode == blind.STILL_READABLE
    assert "started" not in tried.stdout


def test_the_solver_is_told_of_bags_and_the_machine_only(root):
    [task] = tasks(root, overrides=["profile=smoke"])
    assert not any("delay" in argument or "seals" in argument for argument in task.arguments)
    assert task.arguments[-3:] == ("profile=smoke", "--config-dir", str(task.case / CONFIGURATION))
    assert root.machine("abc") == MachineSpecification("bobcat_e10", 20.0, machine().joints)


SOLVER = """
import os, sys, time
print(os.getcwd(), *sys.argv[1:])
if "slow=1" in sys.argv:
    time.sleep(60)
"""


def test_a_run_is_logged_and_timed_and_a_hanging_one_is_ended(root, tmp_path, monkeypatch):
    (tmp_path / "stand_in.py").write_text(SOLVER)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for override, limit_s, status in (("slow=0", 60.0, 0), ("slow=1", 2.0, TIMED_OUT)):
        [task] = tasks(root, overrides=[override])
        assert not is_solved(task, again=True)
        with sealed(root.seals):
            run(task, root.seals, timeout_s=limit_s, module="stand_in")
        assert json.loads((task.solution / RUN_FILE).read_text())["status"] == status
        assert is_solved(task, again=False)
        assert is_solved(task, again=True) == (status == 0)
        (task.solution / RUN_FILE).unlink()
    log = (task.solution / LOG_FILE).read_text()
    assert f"nominal={task.case / 'nominal'}" in log
    assert str(tmp_path) not in log.split()[0]  # its working folder


def test_a_case_is_solved_again_by_other_code(root):
    [task] = tasks(root, overrides=[])
    task.solution.mkdir(parents=True)
    for code, solved in ((fingerprint(), True), ("other", False)):
        (task.solution / RUN_FILE).write_text(json.dumps({"status": 0, "seconds": 1.0, "code": code}))
        assert is_solved(task, again=False) is solved


def test_the_score_is_read_from_files(root):
    assert outcomes(records(root)) == []
    solution = root.solutions / "abc"
    solution.mkdir(parents=True)
    (solution / "run.json").write_text(json.dumps({"status": 0, "seconds": 12.0}))
    given = answer(reported("delay", ["swing"], {"added_delay": (0.21, (0.19, 0.23))}))
    (solution / "closed_loop.json").write_text(json.dumps(given))
    [outcome] = outcomes(records(root))
    assert outcome.hits == (True,)
    text = report("abc123", [outcome])
    assert "| detected | ≥ 95 % | 100.0 % of 1 (2.5 % to 100.0 %) |" in text
    row = "| abc | plant 8 | delay | 2.0 | same | delay swing | named | delay | yes | – | 5.0 % | 1/1 | – | 12 |"
    assert row in text
    (solution / "run.json").write_text(json.dumps({"status": "timeout", "seconds": 600.0}))
    [failed] = outcomes(records(root))
    assert (failed.verdict, failed.detected, failed.hits) == ("failed", False, (False,))


def test_the_ledger_keeps_every_case_once_per_code_and_scores_it_alike(tmp_path):
    onset = Onset("2025-01-01", 30.0)
    truth = truth_of(true_effect("change_point", ["arm"], {"added_delay": 0.2}, of="delay", onset=onset))
    given = answer(reported("delay", ["arm"], {"added_delay": (0.21, (0.19, 0.23))}))
    solution = Solution(0, 12.0, given, {"before": FLOOR | {"arm": 0.05}, "after": FLOOR})
    path = tmp_path / "folder" / "ledger.jsonl"
    first = Record("abc", "code1", truth, solution)
    again = [first, replace(first, code="code2")]
    assert read(path) == []
    assert add(path, [first]) == [first]
    assert add(path, again) == again
    assert read(path) == again
    assert outcomes(read(path)[:1]) == outcomes([first])
    assert len(path.read_text().splitlines()) == 2


def test_a_damaged_ledger_is_refused_by_its_line(tmp_path):
    path = tmp_path / "ledger.jsonl"
    add(path, [Record("abc", "code", DELAY, Solution(0, 1.0, None, None))])
    path.write_text(path.read_text() + "{}\n")
    with pytest.raises(InputError, match=r"ledger\.jsonl, line 2: no record"):
        read(path)


def test_the_fingerprint_is_of_code_and_settings(monkeypatch):
    before = fingerprint()
    assert before == fingerprint() and len(before) == 12
    monkeypatch.setattr("pipeline.discrepancy.diagnosis.nominal.fingerprint.DECISIVE", ("effects",))
    assert fingerprint() != before
