"""Term selection by forward regression with orthogonal least squares (FROLS).

In each step the candidate term that explains most of the remaining output is selected; then candidates and output
are made orthogonal to it. The error reduction ratio (ERR) of a term is the share of the output's energy that it
explains. (Chen, Billings, Luo, "Orthogonal least squares methods and their application to
non-linear system identification", Int. J. Control 50(5), 1989; Korenberg, Billings, Liu, McIlroy, "Orthogonal
parameter estimation algorithm for non-linear stochastic systems", Int. J. Control 48(1), 1988; Billings,
"Nonlinear System Identification", Wiley 2013, chapter 3.)

The selection works on the candidates' inner products instead of the candidates: removing a selected term from
them is a step of a pivoted Cholesky decomposition. So memory and time do not grow with the number of rows.
"""

from dataclasses import dataclass

import numpy as np

# A candidate with a smaller share of remaining energy is a combination of the selected terms, up to rounding.
COLLINEAR = 1e-10
# A smaller share of the output's energy is rounding, as inner products square the values.
ROUNDING = 1e-12


@dataclass(frozen=True)
class TermSelection:
    """Selected terms, in the order of their selection.

    Attributes:
        terms: (n_terms,) indices of candidates.
        error_reduction_ratios: (n_terms,) ERR of each, in [0, 1].
    """

    terms: np.ndarray
    error_reduction_ratios: np.ndarray

    def first(self, n_terms: int) -> "TermSelection":
        """The first `n_terms` terms."""
        return TermSelection(self.terms[:n_terms], self.error_reduction_ratios[:n_terms])


def select_terms(
    gram: np.ndarray, correlation: np.ndarray, energy: float, n_rows: int, maximum_terms: int
) -> TermSelection:
    """Select the terms of one output; their number has the smallest Bayesian information criterion.

    The criterion of n terms is N ln(unexplained share) + n ln N (Billings 2013, section 3.3). The search ends
    at `maximum_terms`, or if only rounding remains unexplained.

    Args:
        gram: (n_candidates, n_candidates) float64, inner products of the candidates over the rows.
        correlation: (n_candidates,) inner products of the candidates with the output.
        energy: Inner product of the output with itself.
        n_rows: N, number of rows in the inner products.
        maximum_terms: Most terms to select.

    Returns:
        The terms; empty if the output is zero.
    """
    left, explained = gram.copy(), correlation.copy()
    initial = np.diag(gram).copy()
    terms: list[int] = []
    ratios: list[float] = []
    criteria = [0.0]  # without terms
    unexplained = 1.0
    while energy > 0.0 and unexplained > ROUNDING and len(terms) < min(maximum_terms, len(gram)):
        remaining = np.diag(left)
        usable = remaining > COLLINEAR * initial
        usable[terms] = False
        if not usable.any():
            break
        ratio = np.where(usable, explained**2 / np.where(usable, remaining, 1.0), 0.0) / energy
        best = int(np.argmax(ratio))
        terms.append(best)
        ratios.append(float(ratio[best]))
        unexplained = max(unexplained - ratios[-1], ROUNDING)
        criteria.append(n_rows * np.log(unexplained) + len(terms) * np.log(n_rows))
        direction = left[best] / left[best, best]
        explained -= explained[best] * direction
        left -= np.outer(direction, left[best])
    n_terms = int(np.argmin(criteria))
    return TermSelection(np.array(terms[:n_terms], np.intp), np.array(ratios[:n_terms]))
