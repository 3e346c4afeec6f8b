"""What a `flow_coupling` on one joint says: the speed lost while others draw flow, and that lost by itself."""

from pipeline.discrepancy.selection.candidate import Candidate

LOSS = "loss_fraction"


def coefficients_by_source(candidate: Candidate) -> dict[int, int]:
    """Per joint that draws from the same flow, the index of its coefficient; the joint itself is no source."""
    names = [freed[0] for freed in candidate.freed]
    return {
        source: index
        for index, (name, source) in enumerate(names)
        if name == LOSS and isinstance(source, int) and source != candidate.joint
    }


def is_shared(candidate: Candidate) -> bool:
    """Whether what others take, not what is missing anyway, is most of the loss at full demand, and less than all."""
    from_others = sum(candidate.coefficients[index] for index in coefficients_by_source(candidate).values())
    alone = [c for f, c in zip(candidate.freed, candidate.coefficients, strict=True) if f[0][0] != LOSS]
    return max(alone, default=0.0) < from_others < 1.0 - max(alone, default=0.0)
