"""The report of a closed loop: one self-contained page for control engineers."""

import re
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from pipeline.discrepancy.verdict.report_data import ReportData
from pipeline.files.atomic import write_whole
from pipeline.reporting.closed_loop import figures
from pipeline.reporting.closed_loop.errors import (
    columns_of,
    error_rows,
    level_name,
    levels_of,
    missing_levels,
    winner_sentences,
)
from pipeline.reporting.closed_loop.method import key_figures, memory_sentence, provenance, residual_answer
from pipeline.reporting.closed_loop.power import visible_sizes
from pipeline.reporting.closed_loop.search import alternatives, effect_cards, ranking, ranking_answer
from pipeline.reporting.closed_loop.verdict import is_corrected, verdict_sentence

TRACKS_DRAWN, TRACKS_OPEN = 24, 4  # logs that are drawn, and logs that are open at first
FOUR_SECONDS = 80  # steps
_NO_SIGNATURE = {
    "none": "no effect was found.",
    "unexcited": "the logs do not show enough to draw one.",
}


def write_closed_loop_report(
    path: Path, document: dict[str, Any], evidence: ReportData, machine_name: str, nominal: str, measured: str
) -> None:
    """Write the report as one self-contained HTML file.

    Args:
        path: The file; a missing folder is created.
        document: `closed_loop.json` (contract, section 4).
        evidence: Data of the figures.
        machine_name: Name of the machine.
        nominal: The nominal logs, as the user named them.
        measured: The measured logs, likewise.

    Raises:
        InputError: The file cannot be written.
    """
    page = closed_loop_page(document, evidence, machine_name, nominal, measured)
    write_whole(path, page.encode())


def closed_loop_page(
    document: Mapping[str, Any], evidence: ReportData, machine_name: str, nominal: str, measured: str
) -> str:
    """Lay out the page; see `write_closed_loop_report` for the arguments."""
    corrected = is_corrected(document)
    levels = levels_of(document, evidence)
    long_level = next((level for level in levels if level.steps == FOUR_SECONDS), None)
    tracks = figures.track_rows(evidence, TRACKS_DRAWN, corrected)
    template = (
        resources.files("pipeline.reporting.closed_loop")
        .joinpath("report.html.j2")
        .read_text(encoding="utf-8")
    )
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(template).render(
        title=f"{machine_name}: what the measured machine does that its model does not",
        verdict=_unbroken(verdict_sentence(document, evidence)),
        key_figures=key_figures(document, evidence),
        corrected=corrected,
        colours={"before": figures.BEFORE, "after": figures.AFTER},
        residual_answer=residual_answer(evidence, corrected),
        residual_panels=_marked(figures.residual_bars(evidence, corrected)),
        memory=memory_sentence(evidence),
        purposes=list(figures.PURPOSE_COLOURS.values()),
        tracks=[(name, _marked(panels)) for name, panels in tracks],
        tracks_open=TRACKS_OPEN,
        tracks_left_out=len(evidence.tracks) - len(tracks),
        signatures=_marked(figures.signature_panels(evidence)),
        lines=any(figures.corrects(one) for one in evidence.signatures),
        lines_missing=not all(figures.corrects(one) for one in evidence.signatures),
        no_signature=_NO_SIGNATURE.get(str(document["verdict"]), "the search left none."),
        rows=error_rows(document, evidence),
        headings=list(columns_of(document, evidence).values()),
        winners=winner_sentences(document, evidence),
        missing=missing_levels(evidence),
        error_level=level_name(FOUR_SECONDS),
        error_panels=_marked(figures.error_bars(evidence, long_level, corrected) if long_level else []),
        ranking=ranking(evidence),
        ranking_answer=ranking_answer(document, evidence),
        alternatives=alternatives(document),
        effects=effect_cards(document),
        warnings=evidence.warnings,
        joints=evidence.joints,
        visible=visible_sizes(document, evidence.joints),
        next_experiment=document.get("next_experiment"),
        provenance=provenance(document, machine_name, nominal, measured),
        steps=evidence.steps,
        seconds=[(name, f"{value:.1f} s") for name, value in evidence.seconds.items()],
        total_seconds=f"{np.sum(list(evidence.seconds.values())):.0f} s in all",
        trajectories=list((document.get("held_out") or {}).get("trajectories") or []),
    )


def _marked(panels: Sequence[str]) -> list[Markup]:
    """Panels as markup; they escape names themselves."""
    return [Markup(panel) for panel in panels]


def _unbroken(sentence: str) -> str:
    """Keep numbers on one line with sign and unit."""
    no_break = "\u00a0"
    sentence = re.sub(r"(?<=\d) (?=%|s\b|m?rad|m?m\b|Hz)", no_break, sentence)
    return sentence.replace("p = ", f"p{no_break}={no_break}")
