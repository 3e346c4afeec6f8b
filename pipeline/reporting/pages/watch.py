"""The page of watched machines, from the documents that `watch` wrote: one machine, or a fleet."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.reporting.figures.evidence import course_figure, evidence_figure
from pipeline.reporting.page import SVG, Figure, KeyFigure, Points, Section, render_page
from pipeline.reporting.results.files import read_json
from pipeline.reporting.table import Table
from pipeline.watch.document import DOCUMENT

STATES = {"healthy": "healthy", "changed": "changed", "not_enough": "not enough to tell"}


def write(folder: Path, page: Path) -> None:
    """Write the page of all machines whose `watch.json` lies in a folder or below.

    Raises:
        InputError: There is none, one is damaged, or the page cannot be written.
    """
    paths = sorted(folder.rglob(DOCUMENT))
    if not paths:
        raise InputError(f"{folder}: holds no {DOCUMENT}; run the stage `watch` first")
    documents = {_name(path, folder): read_json(path) for path in paths}
    write_whole(page, fleet_page(documents).encode())


def fleet_page(documents: Mapping[str, dict[str, Any]]) -> str:
    """HTML of the machines by name, the changed ones first."""
    order = ("changed", "not_enough", "healthy")
    names = sorted(documents, key=lambda name: (order.index(documents[name]["state"]), name))
    states = [documents[name]["state"] for name in names]
    changed = [name for name in names if documents[name]["state"] == "changed"]
    verdict = f"Changed: {', '.join(changed)}." if changed else "No machine shows a change."
    figures = [KeyFigure(str(states.count(state)), words) for state, words in STATES.items()]
    rows = [_row(name, documents[name]) for name in names]
    columns = ["machine", "state", "what changed", "latest session", "sessions", "evidence"]
    overview = Table("Machines", columns, rows)
    sections = [Section("All machines", "State after the latest session.", tables=[overview])]
    sections += [_section(name, documents[name]) for name in names]
    return render_page("Watched machines", verdict, figures, sections, [])


def _name(path: Path, folder: Path) -> str:
    """A machine is called as its folder is, one alone as its kind."""
    below = path.parent.relative_to(folder).as_posix()
    return str(read_json(path)["machine"]) if below == "." else below


def _row(name: str, document: dict[str, Any]) -> list[str]:
    sessions, findings = document["sessions"], document["findings"]
    latest = sessions[-1]["begin"][:10] if sessions else "none"
    open_ones = [of for of in findings if of["until"] is None]
    what = _told(open_ones[-1]) if open_ones else ""
    evidence = f"{document['e_value']:.2g} (alarm at {document['alarm_at']:g})"
    return [name, STATES[document["state"]], what, latest, str(len(sessions)), evidence]


def _told(finding: dict[str, Any]) -> str:
    """A change in a clause: its cause where one was found."""
    joints = ", ".join(finding["joints"])
    cause = (finding["cause"] or {}).get("closed_loop")
    if cause is None or not cause["effects"]:
        return f"{joints}: {finding['size']['statistic'].replace('_', ' ')}"
    effect = cause["effects"][0]
    sure = "" if effect["certain"] else ", not certain"
    values = ", ".join(
        f"{key.replace('_', ' ')} {of['value']:.3g}{'' if of['unit'] in ('1', 'sign') else ' ' + of['unit']}"
        for key, of in effect["parameters"].items()
        if of["value"] is not None
    )
    return f"{', '.join(effect['joints'])}: {effect['family'].replace('_', ' ')} ({values}){sure}"


def _section(name: str, document: dict[str, Any]) -> Section:
    sessions = document["sessions"]
    if not sessions:
        return Section(name, "No session yet.")
    figures = [
        Figure("Evidence", "From the line on a machine counts as changed.", evidence_figure(document), SVG)
    ]
    figures += [
        Figure(
            f"Since {of['onset']['session']}",
            "Grey: range before the change. Dashed: trend.",
            course_figure(of),
            SVG,
        )
        for of in document["findings"]
    ]
    points = (
        [Points("Changes", [_sentence(of) for of in document["findings"]])] if document["findings"] else []
    )
    left_out = [f"{of['name']}: {of['why']}" for of in document["not_counted"]]
    if left_out:
        points.append(Points("Logs that do not count", left_out, folded=True))
    answer = f"{STATES[document['state']].capitalize()}, after {len(sessions)} sessions."
    return Section(name, answer, figures=figures, points=points, gallery=True)


def _sentence(finding: dict[str, Any]) -> str:
    onset, trend = finding["onset"], finding["trend"]
    how = "has grown since" if onset["course"] == "ramp" else "began with"
    text = f"{_told(finding)}. It {how} session {onset['session']}"
    first, last = onset["interval"]
    text += "" if first == last else f" (95 %: {first} to {last})"
    text += f", and was found after {finding['alarm']}"
    text += "." if finding["until"] is None else f"; gone since {finding['until']}."
    if trend is not None and trend["reaches_limit_in_sessions"] is not None:
        fewest, most = trend["reaches_limit_in_sessions"]
        limit = f"{trend['limit']:g} {finding['size']['unit']}".removesuffix(" 1")
        text += f" It reaches {limit} in {fewest} to {most} sessions."
    return text
