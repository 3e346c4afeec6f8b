"""What became of every candidate: seen by the screen, chosen by the search, told, or refused at which test."""

from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.confirmation import Confirmed
from pipeline.discrepancy.acceptance.gate import GateConfig
from pipeline.discrepancy.verdict.verdict import Verdict


def trace_of(verdict: Verdict) -> dict[str, Any]:
    """`screened`: candidates that passed the first screen; `chosen`: those that confirmation rows were asked about."""
    selection, acceptance, joints = verdict.selection, verdict.acceptance, verdict.logs.joints
    borne_out = {f.candidate.key for f in acceptance.fit.found}
    told = {f.candidate.key for f in verdict.correction.fit.found}
    chosen = []
    for effect in selection.found:
        key = effect.candidate.key
        judgement = acceptance.judgements[key]
        refused = None if key in told else _refused_at(judgement, verdict.logs.config.gate)
        if refused is None and key not in told:
            refused = "open loop" if key in borne_out else "size"
        bound = judgement.bound if np.isfinite(judgement.bound) else None
        of = {"bound": bound, "p_value": judgement.p_value, "refused_at": refused}
        chosen.append({"family": key[0], "joint": joints[key[1]], "share": judgement.share, **of})
    passed = [c for c in selection.screened if selection.comparison.passes(c)]
    screened = [{"family": c.family, "joint": joints[c.joint], "share": float(c.share)} for c in passed]
    return {"screened": screened, "chosen": chosen}


def _refused_at(judgement: Confirmed, config: GateConfig) -> str | None:
    if judgement.is_confirmed:
        return None
    if judgement.bound <= config.smallest_improvement:
        return "bound"
    return "agreement" if judgement.p_value < config.largest_p else "placebos"
