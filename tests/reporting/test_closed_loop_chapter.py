"""The report's chapter on the closed loop: verdict, errors, link and what the seal said."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.configuration.load import load_machine
from pipeline.control.repair.comparison import Comparison, PairedRate
from pipeline.reporting.chapters.closed_loop import closed_loop_section, closed_loop_table, seal_sentence
from pipeline.reporting.page import render_page
from pipeline.reporting.results.artifacts import ClosedLoopResult
from tests.reporting.test_closed_loop import documents

MACHINE = load_machine("bobcat_e10")
PAGE, OUTPUT = Path("artifacts/close_loop/report.html"), Path("artifacts/report")
RIGHT = {
    "verdict_right": True,
    "family_right": True,
    "joints_right": True,
    "among_equivalents": True,
    "truth": ["gain on arm (speed_ratio 0.75)"],
    "said": ["gain on arm (speed_ratio 0.72)"],
}
NOTHING = {"verdict_right": False, "family_right": False, "joints_right": False, "among_equivalents": False}


def result(verdict: str, judgement: dict[str, Any] = RIGHT) -> ClosedLoopResult:
    return ClosedLoopResult(documents()[verdict], judgement, PAGE)


@pytest.mark.parametrize("verdict", documents())
def test_every_verdict_has_its_chapter(verdict: str) -> None:
    section = closed_loop_section(MACHINE, result(verdict), OUTPUT)
    page = render_page("Title", "Verdict", [], [section], [])
    assert 'href="../close_loop/report.html"' in page and "&lt;a" not in page
    assert section.answer.endswith(".") and len(section.tables) == 1


def test_the_table_holds_the_documents_errors() -> None:
    table = closed_loop_table(MACHINE, result("named"))
    assert table is not None
    rows = {row[0]: row[1:] for row in table.rows}
    # before, after, fine-tuned (1.2 times after), black box (1.4 times after), floor, mrad
    assert rows["arm, affected [mrad]"] == ["107", "41.0", "49.2", "57.4", "35.0"]
    assert rows["swing [mrad]"][:2] == ["31.0", "31.0"]


@pytest.mark.parametrize(
    ("judgement", "said"),
    [
        (RIGHT, "has gain on arm (speed_ratio 0.75). The verdict is right: effect and joints"),
        (RIGHT | NOTHING | {"said": []}, "wrong: nothing was found"),
        (RIGHT | NOTHING | {"truth": []}, "has nothing. The verdict is wrong: a false alarm"),
        (RIGHT | NOTHING | {"truth": [], "said": []}, "undecided: the logs could not tell"),
        (RIGHT | {"verdict_right": False}, "undecided: what it names is true"),
        (RIGHT | {"verdict_right": False, "joints_right": False}, "wrong about the joints"),
        (RIGHT | NOTHING | {"said": ["lag on arm"]}, "wrong: it says lag on arm"),
        (RIGHT | NOTHING | {"among_equivalents": True}, "not right: the truth is among what it names"),
        ({"note": "these logs are your own"}, "No seal was opened: these logs are your own."),
    ],
)
def test_the_seal_is_told_of_whatever_it_said(judgement: dict[str, Any], said: str) -> None:
    assert said in seal_sentence(judgement)


def test_without_measured_logs_the_chapter_says_so() -> None:
    closed_loop = ClosedLoopResult({"note": "measured holds no logs"}, {"note": "nothing to judge"}, PAGE)
    section = closed_loop_section(MACHINE, closed_loop, OUTPUT)
    assert section.answer == "The loop was not closed."
    assert list(section.paragraphs) == ["measured holds no logs."]
    assert closed_loop_table(MACHINE, closed_loop) is None


def test_a_repair_stands_beside_the_errors() -> None:
    """Rates and intervals of the document, place by place; the picture is there."""
    rates = Comparison(
        100,
        PairedRate.of(*(np.arange(100) < n for n in (75, 89))),
        PairedRate.of(*(np.arange(100) < n for n in (60, 11))),
    ).as_dict(margin=0.05)
    document = {**rates, "on_model": rates, "on_machine": rates, "reason": "it reaches more"}
    section = closed_loop_section(MACHINE, replace(result("named"), repair=document), OUTPUT)
    table = section.tables[1]
    assert [row[0] for row in table.rows] == ["model with what was found", "changed machine"]
    assert table.rows[1][1:4] == ["100", "0.75", "0.89"] and table.rows[1][4].startswith("+14 (+7 to +21")
    assert len(section.figures) == 1 and b"<svg" in section.figures[0].content
    assert "The repaired policy may replace the former one: it reaches more." in section.paragraphs[0]


def test_where_nothing_was_repaired_the_chapter_says_why() -> None:
    section = closed_loop_section(
        MACHINE, replace(result("none"), repair={"note": "it has no effects"}), OUTPUT
    )
    assert section.paragraphs[0] == "No policy was repaired: it has no effects."
    assert len(section.tables) == 1 and not section.figures
