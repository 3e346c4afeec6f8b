"""What the loop's finding does for the policy: both policies over the same targets, on the model and on the machine."""

from collections.abc import Mapping
from typing import Any

from pipeline.reporting.figures.before_after import BeforeAfter
from pipeline.reporting.table import Table

FORMER, REPAIRED = "former policy", "repaired policy"
PLACES = {"on_model": "model with what was found", "on_machine": "changed machine"}


def repair_table(document: Mapping[str, Any]) -> Table | None:
    """Success and departures of both policies; None where nothing was repaired."""
    places = _driven(document)
    if not places:
        return None
    position, pitch = places["on_model"]["precision"]
    rows = [
        [
            PLACES[place],
            str(of["n_targets"]),
            *(f"{of[f'sr_{when}']:.2f}" for when in ("before", "after")),
            _points(of["difference"]),
            *(f"{of[f'oow_{when}']:.2f}" for when in ("before", "after")),
            _points(of["oow_difference"]),
        ]
        for place, of in places.items()
    ]
    rate = f"SR({position:g}, {pitch:g})"
    return Table(
        "The policy before and after its repair, over the same targets",
        ["On", "Targets", f"{rate} former", "repaired", "points", "OOW former", "repaired", "points"],
        rows,
        ["Points: difference with its 95 % interval. OOW: share of trials that left W+ at any tick."],
    )


def repair_sentence(document: Mapping[str, Any]) -> str:
    """Whether the repaired policy may replace the former one, and why."""
    if "note" in document:
        return f"No policy was repaired: {document['note']}."
    may = "may" if document["promotable"] else "may not"
    return f"The repaired policy {may} replace the former one: {document['reason']}."


def repair_panel(document: Mapping[str, Any]) -> BeforeAfter | None:
    """Shares of trials, on the machine if it was driven; None where nothing was repaired."""
    places = _driven(document)
    if not places:
        return None
    place, of = list(places.items())[-1]
    rows = {
        "targets reached": (of["sr_before"], of["sr_after"]),
        "left W+": (of["oow_before"], of["oow_after"]),
    }
    return BeforeAfter(f"Targets, on the {place.split('_')[1]}", (FORMER, REPAIRED), rows, 1.15)


def _driven(document: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    return {place: document[place] for place in PLACES if document.get(place)}


def _points(difference: Mapping[str, Any]) -> str:
    low, high = difference["ci95"]
    return f"{100 * difference['value']:+.0f} ({100 * low:+.0f} to {100 * high:+.0f})"
