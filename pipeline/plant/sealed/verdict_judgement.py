"""Comparison of a verdict with the truth: a seal against the contract's `closed_loop.json`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

CHANGE_POINT, OTHER = "change_point", "other"
OWN_VARIABLES = (
    "command",
    "direction",
)  # an affected joint moves only when commanded, so these may be named in addition

Content = Mapping[str, Any]


@dataclass(frozen=True)
class VerdictJudgement:
    """How a verdict compares with the truth.

    Attributes:
        verdict_right: Families and joints are right and the verdict is certain; without effects, nothing was found.
        family_right: Number and families of effects are right; outside the catalogue the dependence counts.
        joints_right: Exactly the affected joints were named.
        among_equivalents: Every true family is named, or listed among the explanations that the logs cannot separate.
        truth: The switched-on effects, in words.
        said: The verdict's effects, in the same words.
    """

    verdict_right: bool
    family_right: bool
    joints_right: bool
    among_equivalents: bool
    truth: list[str]
    said: list[str]


def judge_verdict(truth: Sequence[Content], document: Content) -> VerdictJudgement:
    """Compare a closed loop's document with its seal.

    Args:
        truth: Result of `open_seal`; empty if nothing was switched on.
        document: The contract's `closed_loop.json` (section 4).
    """
    verdict, said = document["verdict"], list(document.get("effects") or [])
    true_labels = sorted(_true_label(effect) for effect in truth)
    dependence_right = all(_names_dependence(effect, said) for effect in truth if effect["family"] == OTHER)
    family_right = true_labels == sorted(map(_said_label, said)) and dependence_right
    joints_right = _joints(truth) == _joints(said)
    twins = [other for other in document.get("alternatives") or [] if other.get("equivalent")]
    sure = verdict in ("named", "outside_catalogue") if truth else verdict == "none"
    return VerdictJudgement(
        verdict_right=bool(sure and family_right and joints_right),
        family_right=family_right,
        joints_right=joints_right,
        among_equivalents=set(true_labels) <= {_said_label(effect) for effect in (*said, *twins)},
        truth=[_in_words(effect, _true_label(effect)) for effect in truth],
        said=[_in_words(effect, _said_label(effect)) for effect in said],
    )


def _true_label(effect: Content) -> str:
    family = str(effect["family"])
    return family if effect["onset_s"] is None else f"{CHANGE_POINT} of {family}"


def _said_label(effect: Content) -> str:
    family = str(effect["family"])
    return f"{family} of {effect['of']}" if family == CHANGE_POINT and "of" in effect else family


def _joints(effects: Sequence[Content]) -> set[str]:
    return {joint for effect in effects for joint in effect.get("joints") or ()}


def _names_dependence(effect: Content, said: Sequence[Content]) -> bool:
    """Whether an effect outside the catalogue names all true dependences and else only the joints' own variables."""
    true = set(effect["depends_on"])
    allowed = {f"{variable}:{joint}" for variable in OWN_VARIABLES for joint in effect["joints"]}
    allowed |= {f"direction:{joint}" for _, _, joint in (entry.partition(":") for entry in true) if joint}
    named = [set(other.get("depends_on") or ()) for other in said if other["family"] == OTHER]
    return any(true <= entries <= true | allowed for entries in named)


def _in_words(effect: Content, label: str) -> str:
    sizes = [
        f"{name} {quantity['value']:.3g}{'' if quantity['unit'] in ('1', 'sign') else ' ' + quantity['unit']}"
        for name, quantity in (effect.get("parameters") or {}).items()
        if ":" not in name
    ]
    joints, on = ", ".join(effect.get("joints") or ()), ", ".join(effect.get("depends_on") or ())
    if label.endswith(OTHER) or not sizes:
        return f"{label} on {joints}, depending on {on or 'what is not known'}"
    return f"{label} on {joints} ({', '.join(sizes)})"
