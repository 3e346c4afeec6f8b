"""What became of every candidate: seen by the screen, chosen by the search, told, or refused at which test."""

from typing import Any

from pipeline.discrepancy.verdict.verdict import Verdict


def trace_of(verdict: Verdict) -> dict[str, Any]:
    """`screened`: candidates that passed the first screen; `chosen`: those that confirmation rows were asked about."""
    selection, acceptance, joints = verdict.selection, verdict.acceptance, verdict.logs.joints
    told = {f.candidate.key for f in verdict.correction.fit.found}
    chosen = []
    for effect in selection.found:
        key = effect.candidate.key
        judgement = acceptance.judgements[key]
        refused = "open loop" if judgement.why_not is None else "confirmation"
        of = {"e_value": judgement.e_value, "refused_at": None if key in told else refused}
        chosen.append({"family": key[0], "joint": joints[key[1]], "share": judgement.share, **of})
    passed = [c for c in selection.screened if selection.comparison.passes(c)]
    screened = [{"family": c.family, "joint": joints[c.joint], "share": float(c.share)} for c in passed]
    return {"screened": screened, "chosen": chosen}
