"""Which step lost an effect: the trace of `closed_loop.json` tells what became of every candidate."""

from collections.abc import Callable, Mapping
from typing import Any

from benchmarks.closed_loop.truth import TrueEffect

NO_ANSWER, NO_TRACE = "no answer", "no trace"
NOT_SCREENED, NOT_CHOSEN, NOT_FIRST = "not screened", "not chosen", "told, but not first or not as it is"
OTHER = "other"
JOINTLESS = "timing"  # on each joint it is seen as a delay, until all joints are compared


def losing_step(
    effect: TrueEffect, answer: Mapping[str, Any], is_of: Callable[[Mapping[str, Any], TrueEffect], bool]
) -> str:
    """The step, in words.

    Args:
        effect: That is not a hit.
        answer: `closed_loop.json`.
        is_of: Whether a reported effect is a true one.
    """
    trace = answer.get("trace")
    if any(is_of(told, effect) for told in answer.get("effects") or ()):
        return NOT_FIRST
    if trace is None:
        return NO_TRACE if answer.get("alternatives") is not None else NO_ANSWER
    chosen = [of for of in trace["chosen"] if _may_be(of, effect)]
    refused = sorted({of["refused_at"] for of in chosen if of["refused_at"] is not None})
    if refused:
        return f"refused at {' and '.join(refused)}"
    if chosen:
        return NOT_FIRST
    return NOT_CHOSEN if any(_may_be(of, effect) for of in trace["screened"]) else NOT_SCREENED


def _may_be(candidate: Mapping[str, Any], effect: TrueEffect) -> bool:
    """Whether a candidate is of the effect's family, or its dependence, on one of its joints."""
    family = effect.of or effect.family
    name, _, variable = str(candidate["family"]).partition(":")
    if candidate["joint"] not in effect.joints:
        return False
    if family == OTHER:
        return name == OTHER and variable in {entry.partition(":")[0] for entry in effect.depends_on}
    return name == family or (family == JOINTLESS and name == "delay")
