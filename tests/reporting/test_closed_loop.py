import copy
import html
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.verdict.report_data import (
    LevelErrors,
    RankedEffect,
    ReportData,
    ResidualTrack,
    Signature,
)
from pipeline.reporting.closed_loop.errors import error_rows, winner_sentences
from pipeline.reporting.closed_loop.quantities import estimate, percent, probability, significant
from pipeline.reporting.closed_loop.report import closed_loop_page, write_closed_loop_report
from pipeline.reporting.closed_loop.verdict import verdict_sentence

JOINTS = ["swing", "boom", "arm", "bucket"]
BEFORE = np.array([0.031, 0.028, 0.107, 0.045])
AFTER = np.array([0.031, 0.028, 0.041, 0.045])
FLOOR = np.array([0.030, 0.027, 0.035, 0.043])


def by_joint(values: np.ndarray) -> dict[str, float]:
    return dict(zip(JOINTS, map(float, values), strict=True))


def gain() -> dict[str, Any]:
    return {
        "family": "gain",
        "joints": ["arm"],
        "depends_on": ["command:arm"],
        "parameters": {
            "speed_ratio": {"value": 0.75, "unit": "1", "ci95": [0.73, 0.77]},
            "direction": {"value": -1, "unit": "sign", "ci95": None},
            "ratio_negative": {"value": 0.7512, "unit": "1", "ci95": [0.7301, 0.7712]},
        },
        "onset": None,
        "certain": True,
        "p_value": 1e-6,
        "error_reduction": 0.85,
    }


def delay() -> dict[str, Any]:
    return {
        "family": "delay",
        "joints": ["swing"],
        "depends_on": ["command:swing"],
        "parameters": {"added_delay": {"value": 0.15, "unit": "s", "ci95": [0.13, 0.17]}},
        "onset": None,
        "certain": True,
        "p_value": 0.002,
        "error_reduction": 0.41,
    }


def document_of(
    verdict: str, effects: list[dict[str, Any]], alternatives: list[dict[str, Any]], after: np.ndarray
) -> dict[str, Any]:
    return {
        "detected": {"none": False, "unexcited": None}.get(verdict, True),
        "verdict": verdict,
        "effects": effects,
        "alternatives": alternatives,
        "error": {
            "one_step_rmse": {"before": by_joint(BEFORE / 40), "after": by_joint(after / 40)},
            "open_loop_rmse_80": {"before": by_joint(BEFORE), "after": by_joint(after)},
        },
        "baselines": {
            "finetune": {"open_loop_rmse_80": by_joint(AFTER * 1.2)},
            "blackbox_residual": {"open_loop_rmse_80": by_joint(AFTER * 1.4)},
            "nominal_floor": {"open_loop_rmse_80": by_joint(FLOOR)},
        },
        "held_out": {
            "rule": "blocks of 40 s in turn: fit, select, confirm; after each boundary 8 s belong to none",
            "n_steps": 4480,
            "trajectories": ["log_1", "log_2"],
        },
        "next_experiment": "Move the arm alone from stop to stop, three times in each direction (40 s).",
    }


def documents() -> dict[str, dict[str, Any]]:
    lag = {
        "family": "lag",
        "joints": ["swing"],
        "error_reduction": 0.40,
        "why_not": "Starts and stops are too few.",
        "equivalent": True,
    }
    load = {
        "family": "load",
        "joints": ["arm"],
        "error_reduction": 0.33,
        "why_not": "No change with the pose.",
    }
    other = delay() | {
        "family": "other",
        "joints": ["boom"],
        "depends_on": ["hold_time", "command:arm"],
        "parameters": {},
        "certain": False,
    }
    onset = gain() | {"family": "change_point", "of": "gain", "onset": {"trajectory": "log_2", "t": 84.0}}
    cold = delay() | {
        "family": "thermal_drift",
        "joints": JOINTS,
        "depends_on": ["time_since_start"],
        "parameters": {
            "cold_speed_loss": {"value": 0.25, "unit": "1", "ci95": [0.2, 0.3]},
            "time_constant": {"value": 310.0, "unit": "s", "ci95": [240.0, 390.0]},
        },
    }
    shorter = BEFORE * np.array([0.6, 1, 1, 1])
    return {
        "none": document_of("none", [], [], BEFORE),
        "named": document_of("named", [gain()], [load], AFTER),
        "several": document_of("named", [gain(), delay()], [load], AFTER * np.array([0.7, 1, 1, 1])),
        "onset": document_of("named", [onset, cold], [load], AFTER * 0.9),
        "ambiguous": document_of("ambiguous", [delay() | {"certain": False}], [lag, load], shorter),
        "outside_catalogue": document_of(
            "outside_catalogue", [other], [load], BEFORE * np.array([1, 0.8, 1, 1])
        ),
        "uncorrected": document_of("outside_catalogue", [other], [], BEFORE),
        "unexcited": document_of("unexcited", [], [], BEFORE),
    }


def evidence_of(document: dict[str, Any], n_block: int = 60) -> ReportData:
    random = np.random.default_rng(1)
    after = np.array(list(document["error"]["open_loop_rmse_80"]["after"].values()))
    tracks = []
    for name in ("log_1", "log_2", "log_3"):
        noise = 1 + 0.25 * random.standard_normal((n_block, 4))
        purpose = np.repeat([Purpose.fit, Purpose.select, Purpose.confirm] * 2, n_block // 6).astype(np.int8)
        purpose[:: n_block // 6] = Purpose.purged
        tracks.append(
            ResidualTrack(
                name, 2.0 + 4 * np.arange(n_block), 0.7 * BEFORE * noise, 0.7 * after * noise, purpose
            )
        )
    x = np.linspace(-0.6, 0.6, 13)
    fitted = np.where(x < 0, -0.25 * x, 0.0)
    error = np.full(13, 0.012)
    noise = 0.008 * random.standard_normal(13)
    signatures = [
        Signature(
            e["family"],
            joint,
            "predicted velocity [rad/s]",
            "axis",
            x,
            fitted + noise,
            error,
            fitted,
            noise,
            "rad/s",
        )
        for e in document["effects"]
        for joint in e["joints"]
    ]
    ranking = [
        RankedEffect("gain", ["arm"], None, 0.84, 0.012, "found"),
        RankedEffect(
            "load", ["arm"], None, 0.61, 0.02, "nothing left to explain once the speed ratio is in the model"
        ),
        RankedEffect("flow_coupling", ["arm"], "boom", 0.22, 0.04, "does as well with the joints exchanged"),
    ] + [
        RankedEffect(family, [joint], None, 0.02 / (i + 1), 0.03, "removes no more than on nominal logs")
        for i, (family, joint) in enumerate(
            (family, joint) for family in ("delay", "lag", "leakage", "other:hold_time") for joint in JOINTS
        )
    ]
    levels = []
    for steps, scale in ((1, 1 / 40), (80, 1.0)):
        a, b = after * scale, BEFORE * scale
        baselines = {"finetune": a * 1.2, "blackbox_residual": a * 1.4, "wrong_effect": b * 0.97}
        if steps == 1:
            baselines["finetune"] = a * np.array([1.2, 1.2, 0.97, 1.2])
        levels.append(
            LevelErrors(
                steps,
                b,
                a,
                np.stack([b * 0.9, b * 1.1]),
                np.stack([a * 0.9, a * 1.1]),
                baselines,
                FLOOR * scale,
                56,
            )
        )
    unknown = np.full(4, math.nan)
    levels.append(
        LevelErrors(1000, unknown, unknown, np.stack([unknown] * 2), np.stack([unknown] * 2), {}, unknown, 0)
    )
    return ReportData(
        list(JOINTS),
        ["rad"] * 4,
        FLOOR * 0.7,
        BEFORE * 0.7,
        after * 0.7,
        np.array([0.4, 0.5, 0.8, 0.4]),
        tracks,
        signatures,
        ranking,
        levels,
        [
            "The boom was never moved alone: its own effects and those of other joints on it are hard to tell apart."
        ],
        ["The residual of the arm is three times that on nominal logs.", "Of 120 hypotheses nine passed."],
        {"reading": 3.2, "identification": 61.0, "search": 22.4, "baselines": 14.0},
    )


def text_of(page: str) -> str:
    return re.sub(
        r"\s+",
        " ",
        html.unescape(re.sub(r"<[^>]+>", " ", re.sub(r"<style>.*?</style>", "", page, flags=re.S))),
    )


class Balance(HTMLParser):
    """Fails on a tag that closes another than the one that is open."""

    VOID = ("meta", "rect", "circle", "path")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        pass

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", documents())
def test_every_verdict_is_one_self_contained_page(name, tmp_path: Path):
    document = documents()[name]
    path = tmp_path / "out" / "report.html"
    write_closed_loop_report(
        path, document, evidence_of(document), "bobcat_e10", "logs/nominal", "logs/measured"
    )
    page = path.read_text(encoding="utf-8").replace("\u00a0", " ")
    assert len(page) < 1_500_000
    assert not re.search(r"https?:|//[a-z]|<script|<link|@import|url\(", page)
    assert "nan" not in text_of(page).lower().split()
    parser = Balance()
    parser.feed(page)
    assert parser.open == []
    assert (
        html.escape(verdict_sentence(document, evidence_of(document)), quote=True).replace("&#x27;", "&#39;")
        in page
    )
    for said in ("log_2", document["next_experiment"], document["held_out"]["rule"], "4480"):
        assert said in text_of(page)


def test_sentence_of_a_named_effect():
    document = documents()["named"]
    assert verdict_sentence(document, evidence_of(document)) == (
        "The arm moves 25 % slower than the model when it moves in the negative direction (speed ratio 0.75, 95 % 0.73 "
        "to 0.77; no other effect explains it as well, p = 1e-6). With that in the model, the 4 s error on held-out "
        "logs falls from 107 to 41 mrad."
    )


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("none", ["nothing that the model lacks", "3.1 times", "arm: 107 mrad against 35"]),
        ("several", ["Two effects", "0.15 s later", "0.13 to 0.17", "31 to 22 mrad (swing)", "with both"]),
        (
            "onset",
            ["from 84 s into log_2", "25 % slower", "0.20 to 0.30", "0.75", "the swing, the boom, the arm"],
        ),
        (
            "ambiguous",
            [
                "Either the swing reacts 0.15 s later",
                "or the swing builds up",
                "cannot tell which",
                "31 to 19",
            ],
        ),
        (
            "outside_catalogue",
            ["no known effect", "held", "command of the arm", "not certain", "from 28 to 22 mrad"],
        ),
        ("uncorrected", ["no correction", "stays at 28 mrad"]),
        ("unexcited", ["cannot tell", "enough motion"]),
    ],
)
def test_sentences_say_the_document(name, said):
    document = documents()[name]
    sentence = verdict_sentence(document, evidence_of(document))
    for part in said:
        assert part.lower() in sentence.lower(), sentence
    assert sentence.count(". ") <= 1 and sentence.endswith(".")  # what was found, then errors


@pytest.mark.parametrize(
    ("family", "parameters", "said"),
    [
        ("lag", {"added_time_constant": (0.1, "s")}, "more slowly"),
        ("lag", {"added_time_constant": (-0.1, "s")}, "faster"),
        (
            "flow_coupling",
            {"loss_fraction": (0.3, "1")},
            "loses up to 30 % of its speed while the boom draws",
        ),
        (
            "load",
            {"mean_speed_ratio_up": (0.8, "1"), "mean_speed_ratio_down": (1.1, "1")},
            "20 % slower going up and 10 % faster going down",
        ),
        (
            "load",
            {
                "mean_speed_ratio_up": (0.75, "1"),
                "mean_speed_ratio_up:boom": (0.7, "1"),
                "mean_speed_ratio_up:arm": (0.8, "1"),
                "mean_speed_ratio_down": (1.0, "1"),
                "mean_speed_ratio_down:boom": (0.6, "1"),
                "mean_speed_ratio_down:arm": (1.4, "1"),
            },
            "30 % slower to 20 % slower going up and 40 % slower to 40 % faster going down",
        ),
        ("supply_variation", {"std_log_speed": (0.1, "1"), "correlation_time": (20.0, "s")}, "some 10 %"),
        ("leakage", {"sag_rate": (-0.012, "rad/s")}, "creeps at −12 mrad/s"),
        ("backlash", {"width": (0.02, "rad")}, "loses 20 mrad"),
        ("backlash", {"width": (0.002, "m")}, "loses 2 mm"),
        (
            "stiction",
            {"mean_extra_time": (0.2, "s"), "rest_threshold": (2.0, "s")},
            "0.2 s late after resting",
        ),
        (
            "end_cushion",
            {"zone_length": (0.2, "rad"), "min_speed_ratio": (0.4, "1"), "side": (1, "1")},
            "upper limit",
        ),
        ("sensor_bias", {"offset": (0.03, "rad"), "scale": (1.02, "1")}, "offset 30 mrad"),
        ("timing", {"latency": (0.1, "s")}, "0.1 s late"),
        ("oscillation", {"frequency": (2.1, "Hz"), "damping_ratio": (0.1, "1")}, "2.1 Hz"),
        ("gain", {"speed_ratio": (1.0, "1")}, "as fast as the model"),
        ("gain", {}, "another speed"),
        ("unheard_of", {}, "shows unheard of"),
    ],
)
def test_every_family_has_words(family, parameters, said):
    effect = gain() | {
        "family": family,
        "depends_on": ["command:arm", "command:boom"],
        "parameters": {n: {"value": v, "unit": u, "ci95": None} for n, (v, u) in parameters.items()},
    }
    document = document_of("named", [effect], [], AFTER)
    assert said in verdict_sentence(document, evidence_of(document))
    assert "nan" not in text_of(closed_loop_page(document, evidence_of(document), "m", "a", "b")).split()


def test_what_the_logs_would_have_shown_stands_by_joint() -> None:
    sizes = [("gain", "swing", 0.0812, "1"), ("gain", "arm", None, "1"), ("backlash", "boom", 0.00942, "rad")]
    power = [dict(zip(("family", "joint", "size", "unit"), of, strict=True)) for of in sizes]
    document = documents()["none"] | {"power": power}
    page = closed_loop_page(document, evidence_of(document), "bobcat_e10", "nominal", "measured")
    rows = re.findall(r"<tr><td>(changed speed|play on reversal)</td>(.*?)</tr>", page)
    assert [(name, re.findall(r">([^<>]+)</td>", cells)) for name, cells in rows] == [
        ("changed speed", ["8 %", "–", "–", "–"]),
        ("play on reversal", ["–", "9.4 mrad", "–", "–"]),
    ]


def test_a_baseline_that_wins_is_named_and_marked():
    document = documents()["named"]
    evidence = evidence_of(document)
    sentences = winner_sentences(document, evidence)
    assert sentences == [
        "The corrected model predicts the arm best of all at 80 steps (4 s).",
        "At 1 step (0.05 s) the fine-tuned network predicts the arm better than the corrected model does: 0.994 "
        "against 1.03 mrad, which is within the uncertainty.",
    ]
    best = {
        (row.level, row.joint): [cell.best for cell in row.cells] for row in error_rows(document, evidence)
    }
    assert best["1 step (0.05 s)", "arm"] == [False, False, True, False, False]
    assert best["80 steps (4 s)", "arm"] == [False, True, False, False, False]
    evidence.levels[0].baselines["finetune"][:] *= 2
    assert winner_sentences(document, evidence) == [
        "The corrected model predicts the arm best of all at 1 step (0.05 s) and 80 steps (4 s)."
    ]
    alone = replace(evidence, levels=[replace(level, baselines={}) for level in evidence.levels])
    assert winner_sentences(document, alone) == [
        "The corrected model predicts the arm better than the model before at 1 step (0.05 s) and 80 steps (4 s)."
    ]
    assert "black-box" not in text_of(closed_loop_page(document | {"baselines": {}}, alone, "m", "a", "b"))


def test_an_effect_that_corrects_nothing_is_not_told_as_a_correction():
    document = documents()["uncorrected"]
    evidence = evidence_of(document)
    for signature in evidence.signatures:
        signature.after[:] = signature.before
        signature.fitted[:] = 0.0
    page = closed_loop_page(document, evidence, "m", "a", "b")
    text = text_of(page)
    for said in ("There is no line: the effect has no equation", "No correction"):
        assert said in text
    for unsaid in (
        "orrected model",
        "goes through the filled dots",
        "fitted effect",
        "left over",
        "times after",
    ):
        assert unsaid not in text
    assert "→" not in text and "removed by the first effect" not in text
    evidence.signatures.append(evidence_of(documents()["named"]).signatures[0])
    text = text_of(closed_loop_page(document, evidence, "m", "a", "b"))
    assert "Where there is no line, the effect has no equation" in text
    assert "goes through the filled dots" in text


def test_empty_evidence_reads_well():
    document = documents()["unexcited"]
    document["error"]["open_loop_rmse_80"] = {"before": dict.fromkeys(JOINTS), "after": {}}
    unknown = np.full(4, math.nan)
    evidence = ReportData(JOINTS, ["rad", "m", "m", "m"], unknown, unknown, unknown, unknown, [], [], [], [])
    text = text_of(closed_loop_page(document, evidence, "machine", "a", "b"))
    assert "nan" not in text.lower().split()
    for said in ("No signature to show", "no noise floor", "No warnings"):
        assert said in text


def test_errors_come_from_the_document_where_the_evidence_has_no_levels():
    document = documents()["named"]
    rows = error_rows(document, ReportData(**{**vars(evidence_of(document)), "levels": []}))
    assert [cell.text for cell in rows[2].cells] == ["107", "41.0", "49.2", "57.4"]


def test_names_are_escaped():
    document = copy.deepcopy(documents()["named"])
    evil = "<evil>&\"arm'"
    document["effects"][0]["joints"] = [evil]
    document["alternatives"][0]["why_not"] = "<i>why</i>"
    for errors in document["error"].values():
        for column in errors.values():
            column[evil] = column.pop("arm")
    evidence = evidence_of(documents()["named"])
    evidence.joints[2] = evil
    page = closed_loop_page(document, evidence, "<u>machine", "<s>nominal", "<s>measured")
    for raw in ("<evil>", "<i>", "<u>", "<s>"):
        assert raw not in page


def test_a_joint_of_several_has_its_parameter_named_in_words():
    document = copy.deepcopy(documents()["named"])
    parameters = document["effects"][0]["parameters"]
    parameters["mean_speed_ratio_up:arm"] = {"value": 0.89, "unit": "1", "ci95": [0.86, 0.92]}
    page = closed_loop_page(document, evidence_of(document), "machine", "a", "b")
    assert "mean speed ratio going up, arm" in page
    assert "mean_speed_ratio_up:arm" in page  # as it stands in the document


def test_many_long_logs_stay_light():
    document = documents()["named"]
    evidence = evidence_of(document, 3600)
    evidence.tracks.extend(evidence.tracks[:1] * 57)
    page = closed_loop_page(document, evidence, "machine", "a", "b")
    assert len(page.encode()) < 1_500_000
    assert "36 further logs are not drawn" in page


def test_numbers_read_well():
    assert [significant(value, 2) for value in (107.3, 41.2, 4.13, 0.0, -0.0004, math.nan)] == [
        "107",
        "41",
        "4.1",
        "0",
        "−0.00040",
        "–",
    ]
    assert estimate({"value": 0.7512, "unit": "1", "ci95": [0.7312, 0.7698]}) == (
        "0.75",
        ("0.73", "0.77"),
        "",
    )
    assert estimate({"value": 0.02, "unit": "rad", "ci95": None}) == ("20", None, "mrad")
    assert (percent(0.41), percent(0.004), probability(1e-6), probability(0.032)) == (
        "41 %",
        "0.4 %",
        "p = 1e-6",
        "p = 0.03",
    )


def test_a_baseline_that_beats_a_model_without_effects_is_named():
    document = documents()["none"]
    evidence = evidence_of(document)
    assert winner_sentences(document, evidence) == []
    evidence.levels[1].baselines["finetune"][2] = 0.05
    assert winner_sentences(document, evidence) == [
        "At 80 steps (4 s) the fine-tuned network predicts the arm better than the model does: 50.0 against 107 mrad."
    ]
    assert "corrected model" not in closed_loop_page(document, evidence, "m", "a", "b")


def test_what_was_known_before_is_told_with_its_size_then_and_now() -> None:
    grown = {
        "before": delay()["parameters"],
        "now": {"added_delay": {"value": 0.22, "unit": "s", "ci95": [0.2, 0.24]}},
    }
    gone = {"family": "gain", "joints": ["arm"], "state": "gone", "before": gain()["parameters"], "now": None}
    known = [{"family": "delay", "joints": ["swing"], "state": "grown", **grown}, gone]
    document = document_of("none", [], [], BEFORE) | {"known": known}
    sentence = verdict_sentence(document, evidence_of(document))
    assert "show nothing that the model lacks" in sentence
    told = sentence.partition("Known before: ")[2]
    size = "added delay 0.22 s, 95 % 0.20 to 0.24; before added delay 0.15 s, 95 % 0.13 to 0.17"
    assert told.startswith(f"pure delay (swing): has grown ({size}). ")
    assert told.endswith("changed speed (arm): is gone.")
