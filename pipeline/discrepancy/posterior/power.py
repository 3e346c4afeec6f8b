"""What these logs would have shown: the size from which on a family on a joint is found with 90 %.

An effect of size s has a score z ~ N(s √I(τ), 1), where I is what the rows say of it beside noise and nuisance. Without
the effect, a larger τ may explain it, at the price of evidence L(τ) ≤ L(τ₀) elsewhere. It is found when

    min over τ of  z² / 2 + L(τ₀) − L(τ)  −  log(1 + σ² I(τ₀)) / 2

times OF_ANY makes up for its prior and for what is asked.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from pipeline.discrepancy.acceptance.power import FOUND_WITH, Visible
from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence, Scatter
from pipeline.discrepancy.posterior.evidence.nominal_joint import LEAST_SHARES
from pipeline.discrepancy.posterior.evidence.products import Products
from pipeline.discrepancy.posterior.explanations import LOG_MORE
from pipeline.discrepancy.posterior.probabilities import OF_ANY
from pipeline.discrepancy.posterior.residual.columns import Term
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.effect import Parameter


class Priced(NamedTuple):
    """One size τ of the nuisance.

    Attributes:
        products: Of all columns.
        price: Log evidence that it costs against the most probable size.
    """

    products: Products
    price: float


def visible_sizes(
    joint: JointEvidence, families: Sequence[str], log_prior: float, least_odds: float
) -> list[Visible]:
    """Of every family with an equation on one joint.

    Args:
        joint: Its rows.
        families: Names.
        log_prior: Of one cause on one joint.
        least_odds: Log odds that are asked of a finding.
    """
    evidence = np.array([joint.evidence_of_nothing(least) for least in LEAST_SHARES])
    scatters = [
        Priced(joint.products_beside((), Scatter(least)), float(evidence.max() - of))
        for least, of in zip(LEAST_SHARES, evidence, strict=True)
    ]
    result = []
    for family in families:
        of_family = joint.without_onset(family)
        if not of_family:
            continue
        needed = least_odds - log_prior - LOG_MORE + np.log(joint.n_alternatives(of_family[0]))
        parameter = KNOWN[family].card.parameters[0]
        sizes = [_visible(joint.terms[index], scatters, needed, parameter) for index in of_family]
        result.append(Visible(family, joint.joint, float(min(sizes)), parameter.unit))
    return result


def _visible(term: Term, scatters: Sequence[Priced], needed: float, parameter: Parameter) -> float:
    """Smallest size of a term that is found; all its coefficients are alike."""
    columns, n = np.array([term.columns]), len(term.columns)
    information = np.array([of.products.of_terms(columns)[0].sum() for of in scatters])
    if information.min() <= 0.0:
        return np.inf
    likeliest = information[int(np.argmin([of.price for of in scatters]))]
    wanted = max(needed, 0.0) / OF_ANY + 0.5 * np.log1p(float(np.mean(term.scale)) ** 2 * likeliest / n)
    of_scatter = [
        np.sqrt(2.0 * max(wanted - scatter.price, 0.0) / of)
        for scatter, of in zip(scatters, information, strict=True)
    ]
    size = max(of_scatter) + norm.ppf(FOUND_WITH) / np.sqrt(likeliest)
    if term.freed:
        return float(size) if size <= np.abs((term.lower, term.upper)).max() else np.inf
    return _of_point(term.point, parameter) if size <= 1.0 else np.inf


def _of_point(point: Mapping[str, float], parameter: Parameter) -> float:
    return abs(point.get(parameter.name, parameter.neutral) - parameter.neutral) or np.inf
