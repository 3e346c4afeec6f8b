"""The blind benchmark's scoring on solutions and truths made by hand, with figures reckoned by hand."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.closed_loop import blind, kinds
from benchmarks.closed_loop.binomial import clopper_pearson, median_interval
from benchmarks.closed_loop.calibration import solve_size, wanted_ratio
from benchmarks.closed_loop.comparison import Solution, compare
from benchmarks.closed_loop.dependence import Dependence, judge_dependence
from benchmarks.closed_loop.draw import Size, draw_case, draw_plan
from benchmarks.closed_loop.folders import CASE_FILE, Folders, sealed
from benchmarks.closed_loop.generate import case_name, variant_of
from benchmarks.closed_loop.goals import abstained, figures, of_stated_size
from benchmarks.closed_loop.ledger import Record, add, fingerprint, read
from benchmarks.closed_loop.parameter_errors import NAMES, parameter_errors, sign_is_right
from benchmarks.closed_loop.score import outcomes, records, report
from benchmarks.closed_loop.simulators import OUTSIDE, PLANT, SIMULATORS
from benchmarks.closed_loop.solve import LOG_FILE, RUN_FILE, TIMED_OUT, is_solved, run, tasks
from benchmarks.closed_loop.truth import Onset, TrueEffect, Truth, from_json
from pipeline.errors import InputError
from pipeline.plant import effects

FLOOR = dict.fromkeys(("swing", "boom", "arm", "bucket"), 0.01)


def true_effect(family, joints, parameters=None, depends_on=(), of=None, onset=None, ratio=2.0):
    stated = {name: {"value": value, "unit": "?"} for name, value in (parameters or {}).items()}
    return TrueEffect(
        family, of, of or family, tuple(joints), tuple(depends_on), stated, onset, "test", 1.0, 2.0, ratio
    )


def truth_of(*true, kind="delay"):
    return Truth(seed=1, kind=kind, variant=0, style="same", effects=tuple(true))


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
        "baselines": {"blackbox_residual": {"open_loop_rmse_80": blackbox or {}}},
    }


def scored(truth, given, exam=None, seconds=10.0, status=0):
    return compare("case", truth, Solution(status, seconds, given, exam), FLOOR)


DELAY = truth_of(true_effect("delay", ["swing"], {"added_delay": 0.2}))


def test_a_right_answer_counts_as_such_with_its_numbers():
    given = answer(
        reported("delay", ["swing", "arm"], {"added_delay": (0.19, (0.17, 0.21))}),
        after={"swing": 0.020, "arm": 0.5},
        blackbox={"swing": 0.025, "arm": 0.1},
    )
    exam = {"before": FLOOR | {"swing": 0.05}, "after": FLOOR | {"swing": 0.02}}
    outcome = scored(DELAY, given, exam)
    assert (outcome.detected, outcome.hits, outcome.wrong_name) == (True, 1, False)
    assert outcome.joints == (1, 1, 0)
    [parameter] = outcome.parameters
    assert parameter.relative == pytest.approx(0.05)
    assert parameter.covered
    assert outcome.reduction == pytest.approx(0.6)
    assert outcome.avoided == pytest.approx((0.05**2 - 0.02**2) / (0.05**2 - 0.01**2))
    assert outcome.beats == {"blackbox_residual": True, "finetune": False}  # on swing; one is not told


def test_a_certain_wrong_family_is_a_wrong_name_an_uncertain_one_and_other_are_not():
    assert scored(DELAY, answer(reported("lag", ["swing"]))).wrong_name
    assert not scored(DELAY, answer(reported("lag", ["swing"], certain=False))).wrong_name
    other = scored(DELAY, answer(reported("other", ["swing"]), verdict="outside_catalogue"))
    assert not other.wrong_name
    assert other.hits == 0
    right_and_more = scored(DELAY, answer(reported("delay", ["swing"]), reported("gain", ["arm"])))
    assert right_and_more.wrong_name
    assert right_and_more.hits == 1


def test_the_right_family_on_another_joint_is_no_hit_and_a_wrong_name():
    elsewhere = scored(DELAY, answer(reported("delay", ["arm"])))
    assert (elsewhere.hits, elsewhere.wrong_name) == (0, True)
    also = scored(DELAY, answer(reported("delay", ["swing", "arm"])))
    assert (also.hits, also.wrong_name) == (1, False)
    twin = {"family": "delay", "joints": ["arm"], "equivalent": True}
    unsure = answer(reported("lag", ["swing"], certain=False), verdict="ambiguous", alternatives=[twin])
    assert scored(DELAY, unsure).half_hits == 0


def test_the_truth_among_equivalent_explanations_is_half_right():
    first = reported("lag", ["swing"], certain=False)
    given = answer(first, verdict="ambiguous", alternatives=[{"family": "delay", "equivalent": True}])
    outcome = scored(DELAY, given)
    assert (outcome.hits, outcome.half_hits) == (0, 1)
    lost = answer(first, verdict="ambiguous", alternatives=[{"family": "delay"}])
    assert scored(DELAY, lost).half_hits == 0
    itself = answer(reported("delay", ["swing"], certain=False), verdict="ambiguous")
    assert (scored(DELAY, itself).hits, scored(DELAY, itself).half_hits) == (0, 1)


def test_pairs_count_twice_in_any_order():
    pair = truth_of(true_effect("delay", ["swing"]), true_effect("gain", ["arm"]), kind="pair")
    both = answer(reported("gain", ["arm"]), reported("delay", ["swing"]))
    assert scored(pair, both).hits == 2
    one = scored(pair, answer(reported("gain", ["arm"])))
    assert one.hits == 1
    assert one.joints == (1, 0, 1)
    third = answer(reported("lag", ["boom"]), reported("gain", ["arm"]), reported("delay", ["swing"]))
    assert scored(pair, third).hits == 1


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
    assert outcome.hits == 1
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
    assert scored(truth, right).hits == 1
    assert scored(truth, wrong).hits == 0
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


def test_goals_are_reckoned_over_the_right_cases():
    right = scored(DELAY, answer(reported("delay", ["swing"], {"added_delay": (0.22, (0.1, 0.3))})))
    missed = scored(DELAY, answer(verdict="none"))
    failed = scored(DELAY, None, status=2)
    quiet = scored(truth_of(kind="null"), answer(verdict="none"))
    alarm = scored(truth_of(kind="null"), answer(reported("gain", ["arm"])))
    half = replace(missed, truth=replace(DELAY, kind="half"))
    left_out = [
        scored(DELAY, answer(reported("lag", ["swing"]))),
        scored(DELAY, answer(reported("other", ["swing"]), verdict="outside_catalogue")),
        scored(DELAY, answer(verdict="none")),
        scored(DELAY, answer(reported("lag", ["swing"], certain=False), verdict="ambiguous")),
    ]
    found = {figure.name: figure for figure in figures([right, missed, failed, quiet, alarm, half], left_out)}
    assert (found["detection"].value, found["detection"].n) == (pytest.approx(1 / 3), 3)
    assert (found["false alarms"].value, found["false alarms"].n) == (0.5, 2)
    assert found["right family named first (pairs count twice)"].value == pytest.approx(1 / 3)
    assert found["right joints (F1)"].value == pytest.approx(2 * 1 / (2 * 1 + 0 + 2))
    assert found["– of effects on some of the joints"].value == found["right joints (F1)"].value
    assert found["parameters: median relative error"].value == pytest.approx(0.1)
    assert found["– with those of effects not found as infinite"].value == math.inf  # two of three
    assert found["lower held-out error than the black-box residual"].n == 3  # who does not answer has lost
    assert found["lower held-out error than the black-box residual"].value == 0.0
    assert found["parameters: 95 % intervals that cover"].value == 1.0
    assert found["half size: detection"].value == 0.0
    assert found["true card deleted: `other` or abstention"].value == 0.75
    assert found["– of these ambiguous"].value == found["– of these `none`"].value == 0.25
    assert found["true card deleted: wrong name"].value == 0.25
    assert [abstained(o) for o in left_out] == [False, True, True, True]


def test_cases_that_stay_below_the_stated_sizes_are_told_apart():
    weak = truth_of(true_effect("delay", ["swing"], ratio=1.1))
    assert not of_stated_size(scored(weak, answer()))
    assert of_stated_size(scored(DELAY, answer()))
    assert of_stated_size(scored(replace(weak, kind="half", effects=DELAY.effects), answer()))
    assert of_stated_size(scored(truth_of(kind="null"), answer()))


def test_intervals_are_exact():
    assert clopper_pearson(0, 60) == (0.0, pytest.approx(1.0 - 0.025 ** (1 / 60)))
    assert clopper_pearson(20, 20) == (pytest.approx(0.025 ** (1 / 20)), 1.0)
    lower, upper = median_interval(range(10))  # 2 of 10 values may lie outside on each side: 2.15 %
    assert (lower, upper) == (1, 8)
    assert median_interval([1.0, 2.0]) == (-math.inf, math.inf)


def test_sizes_are_found_and_bounded():
    def ratio(size):
        return math.sqrt(1.0 + 3.0 * size**2)

    size, reached = solve_size(ratio, 1.5, first=1.0, smallest=0.05, largest=3.0)
    assert reached == pytest.approx(1.5, rel=0.05)
    assert reached == ratio(size)
    assert solve_size(ratio, 100.0, first=1.0, smallest=0.05, largest=2.0)[0] == 2.0
    assert wanted_ratio(0.0, half=False) == pytest.approx(1.3)
    assert wanted_ratio(1.0, half=True) == pytest.approx(2.0)


def test_an_effect_that_cannot_be_strong_enough_is_drawn_anew():
    ratios = iter((1.0, 1.9))

    def calibrate(machine, kind, seed, share, half):
        return Size(1.0, 2.0, next(ratios))

    plan = draw_plan("end_cushion", 0, 0, calibrate)
    assert plan.truth.effects[0].ratio == 1.9
    assert next(ratios, None) is None


def test_the_same_seed_draws_the_same_case(monkeypatch):
    monkeypatch.setattr("benchmarks.closed_loop.draw.MEASURED_MINUTES", (0.3, 0.3))
    monkeypatch.setattr("benchmarks.closed_loop.draw.EXAM_MINUTES", 0.3)
    monkeypatch.setattr("benchmarks.closed_loop.draw._sound_nominal", lambda simulator, number: ())
    one, two, other = (draw_case("delay", seed, 1) for seed in (3, 3, 4))
    assert one.truth == two.truth != other.truth
    assert [t.name for t in one.measured] == [t.name for t in two.measured]
    for first, second in zip(one.measured + one.exam, two.measured + two.exam, strict=True):
        np.testing.assert_array_equal(first.q, second.q)
        np.testing.assert_array_equal(first.a, second.a)
    assert not np.array_equal(one.measured[0].q, other.measured[0].q)


EVERY_KIND = [(s, kind) for s in SIMULATORS.values() for kind in kinds.in_order(s.outside)]


@pytest.mark.parametrize(("simulator", "kind"), EVERY_KIND, ids=lambda item: getattr(item, "name", item))
def test_every_kind_is_drawn_with_its_truth(simulator, kind):
    plan = draw_plan(kind, 2, 2, simulator=simulator)
    assert plan.truth.simulator == simulator.name
    n_effect = {"null": 0, "pair": 2}.get(kind, 1)
    assert len(plan.truth.effects) == n_effect
    assert from_json(plan.truth.to_json()) == plan.truth
    days = {session.start.date() for session in (*plan.nominal, *plan.measured, *plan.exam)}
    assert len(days) == 5
    if kind == "change_point":
        onset = plan.truth.effects[0].onset
        [session] = [s for s in plan.measured if s.name == onset.trajectory]
        assert [time for time, _ in session.changes] == [onset.t]
        assert 0.3 * 360 <= onset.t <= 0.7 * 360
        assert not plan.exam[0].changes
    if kind in OUTSIDE:
        assert plan.truth.effects[0].family == "other"


def test_unknown_kinds_are_refused():
    with pytest.raises(InputError, match="gremlins"):
        draw_plan("gremlins", 0, 0)


def test_names_of_cases_tell_nothing_and_kinds_meet_all_variants():
    names = {case_name(kind, seed, simulator) for simulator, kind in EVERY_KIND for seed in range(5)}
    assert len(names) == 5 * len(EVERY_KIND)
    assert not any(kind in name for _, kind in EVERY_KIND for name in names)
    for simulator in SIMULATORS.values():
        assert {variant_of("gain", seed, 8, simulator) for seed in range(8)} == set(range(8))


@pytest.fixture
def root(tmp_path):
    """A root with one case of a delay, without bags."""
    folders = Folders(tmp_path)
    case = folders.cases / "abc"
    case.mkdir(parents=True)
    (case / CASE_FILE).write_text(json.dumps({"model": "models/variant_0"}))
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
        allowed = run_blind(root, sys.executable, "-c", READ, str(root.cases / "abc" / CASE_FILE))
        assert allowed.returncode == 0
    assert "delay" in (root.seals / "abc.json").read_text()


def test_nothing_is_solved_while_the_seals_are_open(root):
    tried = run_blind(root, sys.executable, "-c", "print('started')")
    assert tried.returncode == blind.STILL_READABLE
    assert "started" not in tried.stdout


def test_the_solver_is_told_of_bags_and_model_only(root):
    [task] = tasks(root, leave_out_true=False, overrides=[])
    assert not any("delay" in argument or "seals" in argument for argument in task.arguments)
    assert f"model={root.root / 'models/variant_0'}" in task.arguments
    [left_out] = tasks(root, leave_out_true=True, overrides=["profile=smoke"])
    assert left_out.arguments[-2:] == ("close_loop.exclude=[delay]", "profile=smoke")


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
        [task] = tasks(root, leave_out_true=False, overrides=[override])
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


def test_the_score_is_read_from_files(root):
    assert outcomes(records(root), leaving_out=False) == []
    solution = root.solutions(leaving_out=False) / "abc"
    solution.mkdir(parents=True)
    (solution / "run.json").write_text(json.dumps({"status": 0, "seconds": 12.0}))
    given = answer(reported("delay", ["swing"], {"added_delay": (0.21, (0.19, 0.23))}))
    (solution / "closed_loop.json").write_text(json.dumps(given))
    [outcome] = outcomes(records(root), leaving_out=False)
    assert outcome.hits == 1
    text = report("abc123", [outcome], [])
    assert "| detection | ≥ 98 % | 100.0 % | yes | 1 |" in text
    assert (
        "| abc | delay 1 | 2.00 | plant | 0, same | delay swing | named | delay | 1/0/0 | yes | 5.0 % | 1/1 |"
        in text
    )
    (solution / "run.json").write_text(json.dumps({"status": "timeout", "seconds": 600.0}))
    [failed] = outcomes(records(root), leaving_out=False)
    assert (failed.verdict, failed.detected, failed.hits) == ("failed", False, 0)
    assert Path(root.root).exists()


def test_the_ledger_keeps_every_case_once_per_code_and_scores_it_alike(tmp_path):
    onset = Onset("2025-01-01", 30.0)
    truth = truth_of(true_effect("change_point", ["arm"], {"added_delay": 0.2}, of="delay", onset=onset))
    given = answer(reported("delay", ["arm"], {"added_delay": (0.21, (0.19, 0.23))}))
    solution = Solution(0, 12.0, given, {"before": FLOOR | {"arm": 0.05}, "after": FLOOR})
    path = tmp_path / "folder" / "ledger.jsonl"
    first = Record("abc", False, "code1", truth, solution, FLOOR)
    again = [first, replace(first, code="code2"), replace(first, is_left_out=True)]
    assert read(path) == []
    assert add(path, [first]) == [first]
    assert add(path, again) == again
    assert read(path) == again
    assert outcomes(read(path)[:1], leaving_out=False) == outcomes([first], leaving_out=False)
    assert len(path.read_text().splitlines()) == 3


def test_a_damaged_ledger_is_refused_by_its_line(tmp_path):
    path = tmp_path / "ledger.jsonl"
    add(path, [Record("abc", False, "code", DELAY, Solution(0, 1.0, None, None), None)])
    path.write_text(path.read_text() + "{}\n")
    with pytest.raises(InputError, match=r"ledger\.jsonl, line 2: no record"):
        read(path)


def test_the_fingerprint_is_of_code_and_settings(monkeypatch):
    before = fingerprint()
    assert before == fingerprint() and len(before) == 12
    monkeypatch.setattr("pipeline.discrepancy.diagnosis.fingerprint.DECISIVE", ("effects",))
    assert fingerprint() != before
