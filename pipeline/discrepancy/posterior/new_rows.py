"""What new rows of the same logs say of explanations: their likelihood, with all that was fitted to other rows.

p(r, r' | h)  =  p(r | h) p(r' | r, h)        r: rows for fitting and selection, r': confirmation rows
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence
from pipeline.discrepancy.posterior.evidence.slow_variations import evidence_of_processes
from pipeline.discrepancy.posterior.explanations import Cause, Explanation, terms_of, with_probabilities

NEGLIGIBLE = -5.0  # log weight of a moment that adds less than 1 % to what is told

Terms = Mapping[int, tuple[int, ...]]


def on_all_rows(
    explanations: Sequence[Explanation], fitted: Sequence[JointEvidence], held_out: Sequence[JointEvidence]
) -> list[Explanation]:
    """Explanations with their evidence on new rows as well, most probable first.

    Args:
        explanations: By the rows for fitting and selection.
        fitted: Per joint, on these rows.
        held_out: Per joint, the same terms on confirmation rows.
    """
    nothing = [new.likelihood_of((), old) for old, new in zip(fitted, held_out, strict=True)]
    result = []
    for explanation in explanations:
        terms, added = terms_of(explanation.causes), 0.0
        if explanation.causes:
            joints = sorted({joint for cause in explanation.causes for joint in cause.joints})
            # Of several causes at most one is averaged over its moments.
            averaged = max(explanation.causes, key=lambda cause: cause.sets_in)
            added = log_predictive(averaged, terms, fitted, held_out, joints)
            added -= sum(nothing[joint] for joint in joints)
        result.append(explanation._replace(log_evidence=explanation.log_evidence + added))
    return with_probabilities(result)


def log_predictive(
    cause: Cause,
    terms: Terms,
    fitted: Sequence[JointEvidence],
    held_out: Sequence[JointEvidence],
    joints: Sequence[int],
) -> float:
    """Log likelihood of new rows of joints; averaged over the moments at which a cause may have set in.

    Args:
        cause: One of the explanation's.
        terms: Of all its causes, by joint.
        fitted: Per joint of the machine.
        held_out: Per joint of the machine.
        joints: In question.
    """
    if not cause.terms:  # what is known of the process comes from the rows that it was found on
        known, new = (evidence_of_processes(of, joints) for of in (fitted, held_out))
        return float(logsumexp(known + new) - logsumexp(known))
    moments = _moments(cause, terms, fitted)
    weights = np.array([weight for weight, _ in moments])
    likelihood = [
        sum(held_out[joint].likelihood_of(of.get(joint, ()), fitted[joint]) for joint in joints)
        for _, of in moments
    ]
    return float(logsumexp(weights + np.array(likelihood)) - logsumexp(weights))


def _moments(cause: Cause, terms: Terms, fitted: Sequence[JointEvidence]) -> list[tuple[float, Terms]]:
    """Log weight of each moment at which a cause may have set in, and the terms by joint then.

    Rows for fitting leave out those for confirmation: within these, any moment is as probable.
    """
    if not cause.sets_in:
        return [(0.0, terms)]
    weights: dict[int, float] = defaultdict(float)
    at: dict[int, dict[int, tuple[int, ...]]] = defaultdict(dict)
    for joint, chosen in cause.terms.items():
        beside = tuple(index for index in terms[joint] if index != chosen)
        _, evidence = fitted[joint].groups(beside)
        for index in fitted[joint].setting_in(fitted[joint].base(chosen)):
            moment = fitted[joint].onsets[index]
            assert moment is not None
            weights[moment] += evidence[index]
            at[moment][joint] = (*beside, index)
    most = max(weights.values())
    return [(weight, {**terms, **at[m]}) for m, weight in weights.items() if weight > most + NEGLIGIBLE]
