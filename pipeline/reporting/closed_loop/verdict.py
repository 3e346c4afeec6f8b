"""The verdict of a closed loop in two sentences, for each verdict of the contract (section 4)."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from pipeline.reporting.closed_loop.clauses import clause
from pipeline.reporting.closed_loop.quantities import (
    number,
    probability,
    readable_unit,
    significant,
    with_unit,
)
from pipeline.reporting.closed_loop.words import (
    Document,
    dependences,
    family_name,
    listed,
    sizes,
)

HORIZON = "open_loop_rmse_80"  # the four-second error
VERDICT_WORDS = {
    "none": "nothing found",
    "named": "effect named",
    "ambiguous": "two explanations",
    "outside_catalogue": "unknown effect",
    "unexcited": "not enough motion",
}
STATE_WORDS = {
    "unchanged": "as it was",
    "grown": "has grown",
    "shrunk": "has shrunk",
    "gone": "is gone",
    "unseen": "these logs do not show it, it stays as it was",
}


class JointUnits(Protocol):
    """Joints with the units of their positions, such as a closed loop's report data."""

    @property
    def joints(self) -> Sequence[str]:
        """Names."""

    @property
    def units(self) -> Sequence[str]:
        """`rad` or `m`, per joint."""


def verdict_sentence(document: Document, evidence: JointUnits) -> str:
    """The finding: effect, joints, size, certainty; then the held-out error before and after."""
    verdict, effects = document["verdict"], list(document.get("effects") or [])
    if verdict == "none":
        text = f"the measured logs show nothing that the model lacks{_nominal_comparison(document, evidence)}"
    elif verdict == "unexcited" or not effects:
        text = (
            "these logs cannot tell whether the machine differs from its model, because they do not hold enough "
            f"motion of the kind that would show it{_nominal_comparison(document, evidence)}"
        )
    elif verdict == "ambiguous":
        twins = [clause(twin) + _size(twin, certainty=False) for twin in equivalents(document)]
        first = f"either {clause(effects[0])}{_size(effects[0], certainty=False)}"
        rest = [f"{clause(effect)}{_size(effect)}" for effect in effects[1:]]
        chance = number(effects[0].get("p_value"))
        text = " or ".join([first, *twins]) + ", and these logs cannot tell which"
        text += (
            f" (probability of such a pattern without any effect: {probability(chance)})"
            if math.isfinite(chance)
            else ""
        )
        text += f"; besides, {listed(rest)}" if rest else ""
        text += _outcome(document, evidence, effects, "With the first of them in the model")
    elif verdict == "outside_catalogue" and len(effects) == 1:
        text = clause(effects[0]) + _size(effects[0])
        text += _outcome(document, evidence, effects, "With an unnamed correction")
    else:
        found = [clause(effect) + _size(effect) for effect in effects]
        lead = "" if len(found) == 1 else f"{_count(len(found))} effects are missing from the model: "
        text = lead + ("; ".join(found[:-1]) + "; and " if found[1:] else "") + found[-1]
        added = {1: "With that in the model", 2: "With both in the model"}
        text += _outcome(document, evidence, effects, added.get(len(found), "With all of them in the model"))
    return text[0].upper() + text[1:] + "." + _known_before(document)


def equivalents(document: Document) -> list[Mapping[str, Any]]:
    """Alternatives that these logs cannot distinguish from the first effect."""
    return [other for other in document.get("alternatives") or [] if other.get("equivalent")]


def affected_joints(document: Document) -> list[str]:
    """Joints of all effects, each once, in the effects' order."""
    return list(dict.fromkeys(name for effect in document.get("effects") or [] for name in effect["joints"]))


def is_corrected(document: Document) -> bool:
    """Whether what was found or refitted changes the model's prediction; an effect may be unpredictable."""
    errors = (document.get("error") or {}).values()
    return bool(document.get("effects") or document.get("known")) and any(
        error.get("before") != error.get("after") for error in errors
    )


def held_out_error(document: Document, when: str, joint: str) -> float:
    """The four-second error `before` or `after`, rad or m; NaN if unknown."""
    errors = document.get("error", {}).get(HORIZON, {}).get(when) or {}
    return number(errors.get(joint))


def certainty_in_words(effect: Document) -> str:
    """Whether another effect explains the logs equally well, and the p-value of the effect."""
    words = "no other effect explains it as well" if effect.get("certain") else "not certain"
    chance = number(effect.get("p_value"))
    return f"{words}, {probability(chance)}" if math.isfinite(chance) else words


def effect_label(effect: Document) -> str:
    """`pure delay (swing)`, for headings and tables."""
    name = family_name(effect["family"])
    if effect["family"] == "change_point" and effect.get("of"):
        name = f"{family_name(effect['of'])}, {name}"
    if effect["family"] == "other" and effect.get("depends_on"):
        name += f": depends on {dependences(effect)}"
    return f"{name} ({listed(effect['joints'])})" if effect.get("joints") else name


def _size(effect: Document, certainty: bool = True) -> str:
    parts = sizes(effect) + ([certainty_in_words(effect)] if certainty else [])
    return f" ({'; '.join(parts)})" if parts else ""


def _known_before(document: Document) -> str:
    """A sentence on effects that the given model has already, each with its size now and before; or nothing."""
    told = []
    for of in document.get("known") or []:
        now, before = ("; ".join(sizes({**of, "parameters": of[when]})) for when in ("now", "before"))
        size = f" ({now}; before {before})" if now and before else ""
        told.append(f"{effect_label(of)}: {STATE_WORDS[of['state']]}{size}")
    return f" Known before: {'. '.join(told)}." if told else ""


def _outcome(document: Document, evidence: JointUnits, effects: Sequence[Document], added: str) -> str:
    changes, falls = [], []
    joints = affected_joints({"effects": effects})
    for joint in joints:
        unit = _unit(evidence, joint)
        factor, _ = readable_unit(unit)
        values = [factor * held_out_error(document, when, joint) for when in ("before", "after")]
        if not all(math.isfinite(value) for value in values):
            continue
        before, after = (significant(value, 2) for value in values)
        falls.append(0 if before == after else values[0] - values[1])
        whose = f" ({joint})" if len(joints) > 1 else ""
        change = (
            f"at {with_unit(after, unit)}"
            if before == after
            else f"from {before} to {with_unit(after, unit)}"
        )
        changes.append(change + whose)
    if not changes:
        return ""
    if all(fall == 0 for fall in falls):
        return f". No correction was taken into the model; its 4 s error on held-out logs stays {listed(changes)}"
    how = (
        "falls" if all(fall > 0 for fall in falls) else "rises" if all(fall < 0 for fall in falls) else "goes"
    )
    return f". {added}, the 4 s error on held-out logs {how} {listed(changes)}"


def _nominal_comparison(document: Document, evidence: JointUnits) -> str:
    """Sentence on the joint with the largest error relative to that on held-out nominal logs."""
    floor = document.get("baselines", {}).get("nominal_floor", {}).get(HORIZON) or {}
    ratios = {
        joint: held_out_error(document, "before", joint) / number(floor[joint])
        for joint in evidence.joints
        if number(floor.get(joint)) > 0 and math.isfinite(held_out_error(document, "before", joint))
    }
    if not ratios:
        return ""
    worst = max(ratios, key=lambda joint: ratios[joint])
    unit = _unit(evidence, worst)
    factor, _ = readable_unit(unit)
    measured, nominal = (
        significant(factor * value, 2)
        for value in (held_out_error(document, "before", worst), number(floor[worst]))
    )
    return (
        f". Its 4 s error on held-out measured logs is at worst {significant(ratios[worst], 2)} times that on nominal "
        f"logs ({worst}: {with_unit(measured, unit)} against {nominal})"
    )


def _unit(evidence: JointUnits, joint: str) -> str:
    return dict(zip(evidence.joints, evidence.units, strict=True)).get(joint, "rad")


def _count(n: int) -> str:
    return {2: "two", 3: "three", 4: "four", 5: "five"}.get(n, str(n))
