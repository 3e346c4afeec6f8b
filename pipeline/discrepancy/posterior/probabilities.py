"""From priors and evidence to probabilities, with as much trust in the evidence as solved cases justify.

The model of the rows is not exact: a machine repeats itself less than three sessions show, and a card is no more than
close to what has changed. So evidence counts with an exponent below one. Whether there is any effect, and which one it
is, are mistaken for different reasons. Each question has an exponent of its own:

P(none)     from  p(h) · evidence(h)^OF_ANY    of all explanations h
P(h | any)  from  p(h) · evidence(h)^OF_NAMES  of those with an effect

Source: Grünwald and van Ommen (2017), Inconsistency of Bayesian inference for misspecified linear models.
"""

import numpy as np
from scipy.special import logsumexp

# Estimated from solved cases, benchmarks.closed_loop.calibrate.
OF_ANY = 0.15
OF_NAMES = 0.26


def log_probabilities(
    log_prior: np.ndarray,
    log_evidence: np.ndarray,
    is_none: np.ndarray,
    of_any: float = OF_ANY,
    of_names: float = OF_NAMES,
) -> np.ndarray:
    """Natural logarithms of the probabilities of explanations, shape (n,); they sum to one.

    Args:
        log_prior: But for a constant, shape (n,).
        log_evidence: Over that of no effect, shape (n,).
        is_none: Which explanation has no effect, shape (n,); one at most.
        of_any: Exponent of the evidence that there is any effect.
        of_names: Exponent of the evidence between explanations with an effect.
    """
    result = _normalised(log_prior + of_any * log_evidence)
    if not is_none.all():
        names = _normalised((log_prior + of_names * log_evidence)[~is_none])
        result[~is_none] = names + logsumexp(result[~is_none])
    return result


def _normalised(score: np.ndarray) -> np.ndarray:
    return np.asarray(score - logsumexp(score))
