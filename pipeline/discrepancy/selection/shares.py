"""How probable an explanation is beside its rivals: the share of resamples of the logs' blocks in which it is best.

A posterior over explanations of which none is exact picks one of them, and on other logs of the same machine another.
Its mean over bootstrap resamples does not: two that explain as much have about a half each. Within one resample, of so
many rows, the best has all of it. Source: Huggins and Miller (2023), Reproducible model selection using bagged
posteriors, Bayesian Analysis 18.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.discrepancy.selection.candidate import Candidate, Key

CREDIBLE = 0.95  # that what is told and what is equivalent to it hold together (contract, section 4)
RESAMPLES = 1000  # which tell a share of 5 % to 0.7 %

Shares = Mapping[Key, float]
"""By the key of an explanation's first candidate."""


def shares_of(explanations: Sequence[Sequence[Candidate]], worth: Sequence[float], seed: int = 0) -> Shares:
    """They sum to one.

    Args:
        explanations: Candidates that act together, on the same rows.
        worth: Per explanation, the factor on what it explains by which it is compared with the others.
        seed: Of the resampling.
    """
    by_block = np.stack([np.sum([c.gain_by_block for c in of], axis=0) for of in explanations])
    owed = np.array([sum(c.owed for c in of) for of in explanations])
    n = by_block.shape[1]
    counts = np.random.default_rng(seed).multinomial(n, np.full(n, 1.0 / n), RESAMPLES)
    best = np.argmax((counts @ by_block.T - owed) * np.asarray(worth), axis=1)
    n_best = np.bincount(best, minlength=len(explanations))
    share = (n_best + 1) / (RESAMPLES + len(explanations))  # rule of succession: no finite number makes sure
    return {of[0].key: float(p) for of, p in zip(explanations, share, strict=True)}


def credible(shares: Shares, told: Sequence[Key]) -> list[Key]:
    """What has to stand beside the keys that are told, likeliest first, for all to hold `CREDIBLE` together."""
    missing, held = [], sum(shares.get(key, 0.0) for key in told)
    for key in sorted(shares.keys() - set(told), key=lambda of: -shares[of]):
        if held >= CREDIBLE:
            break
        missing.append(key)
        held += shares[key]
    return missing
