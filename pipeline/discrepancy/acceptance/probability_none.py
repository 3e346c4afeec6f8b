"""How probable it is that nothing has changed."""

from collections.abc import Sequence

from pipeline.discrepancy.acceptance.e_value import e_value_of


def probability_none(e_values: Sequence[float], is_excited: bool) -> float:
    """By the strongest of the effects that are told; before any row, a change is as probable as none.

    An e-value stands for the Bayes factor against no effect. Where none is told it is that of p = 1; where joints
    hardly move, logs are no evidence at all.

    Args:
        e_values: Of the effects.
        is_excited: Whether joints move enough to tell.
    """
    of_nothing = e_value_of(1.0) if is_excited else 1.0
    return 1.0 / (1.0 + max(e_values, default=of_nothing))
