"""Evidence that a statistic has changed, which holds at any time: one e-process per statistic and joint.

Under the null x_1, x_2, … of a statistic are independent, Student's t with five degrees of freedom at unknown place μ
and scale σ: heavier tails than normal ones. From session v on, under the
alternative, place and scale are μ + δσ and σ √(1 + (δ/4)²): what sessions show of a change varies, the more the larger
it is. Both share the prior of μ and σ, the right Haar one, 1/σ. So the ratio of the marginal likelihoods is an
e-process for every μ and σ. δ and v are averaged over:

    E_t  =  Σ_v w_v ∫ Π_{s<v} f_μσ(x_s) Π_{v≤s≤t} f_μσδ(x_s) dπ(μ,σ) dδ  /  ∫ Π_{s≤t} f_μσ(x_s) dπ(μ,σ),     Σ_v w_v = 1

An e-detector, which sums over v without weights, bounds how often it alarms, not whether it ever does. The weights do:
by Ville's inequality P(E_t ≥ 1/α at any t) ≤ α. Changes below 1.5 σ for good lower the evidence, as δ is 3 at least.

Sources: Pérez-Ortiz, Lardy, de Heide, Grünwald (2024), E-statistics, group invariance and anytime-valid testing;
Wang, Ramdas (2025), Anytime-valid t-tests and confidence sequences for Gaussian means with unknown variance; Shin,
Ramdas, Rinaldo (2024), E-detectors. Averages over joints: Vovk, Wang (2021), E-values: calibration, combination and
applications. The average of e-processes is one where they share a filtration: exactly so only of independent ones.
"""

from typing import NamedTuple

import numpy as np

HALF_LIFE = 100  # sessions: about half of the weight is on changes before, whatever the machine's age
DEGREES = 5
# Nodes may lie as far apart as is little beside the smallest δ.
PLACES = np.linspace(-1.5, 1.5, 15)  # of μ, in nominal standard deviations: five of the mean of ten
SCALES = np.geomspace(0.35, 4.0, 8)  # of σ likewise: beyond both is next to no posterior of ten
SHIFTS = np.concatenate([sign * 3.0 * 1.9 ** np.arange(7) for sign in (-1, 1)])  # δ up to 140
WIDENING = 4.0
# Ratio of likelihoods that a single session may give: 20 over the largest w, so that no single one, however odd, is
# taken for a change. A ratio cut short is evidence still.
MOST_OF_ONE = 2000.0
LARGEST = 1e300  # evidence beyond is told as this


class Grid(NamedTuple):
    """Nodes over which unknowns of K statistics are averaged.

    Attributes:
        place: (K, n_place, 1) μ.
        scale: (K, 1, n_scale) σ.
        prior: (K, n_place, n_scale), sums to 1.
    """

    place: np.ndarray
    scale: np.ndarray
    prior: np.ndarray


def grid_of(nominal: np.ndarray, least: np.ndarray) -> Grid:
    """Nodes around what nominal sessions show.

    Args:
        nominal: (n, K) statistics, two values of each at least; NaN where a session says nothing.
        least: (K,) smallest change worth telling: σ is not below a third of it.
    """
    smallest = least / np.min(np.abs(SHIFTS))
    own = np.maximum(np.nanstd(nominal, axis=0, ddof=1), smallest)
    place = np.nanmedian(nominal, axis=0)[:, None] + own[:, None] * PLACES
    scale = np.maximum(own[:, None] * SCALES, smallest[:, None])
    # on a geometric grid 1/σ is constant
    n_node = len(PLACES) * len(SCALES)
    prior = np.full((len(own), len(PLACES), len(SCALES)), 1.0 / n_node)
    return Grid(place[:, :, None], scale[:, None, :], prior)


def evidence(nominal: np.ndarray, watched: np.ndarray, least: np.ndarray) -> np.ndarray:
    """(t, K) e-values of each statistic after each session.

    Args:
        nominal: (n, K) of sessions from before the watch, in any order.
        watched: (t, K) in the order of recording; NaN where a session says nothing, which leaves the value as it was.
        least: (K,) smallest change worth telling.
    """
    grid = grid_of(nominal, least)
    same = grid.prior.copy()  # prior times likelihood without a change
    for row in nominal:
        same *= _density(row, grid.place, grid.scale)
        same /= same.sum(axis=(1, 2), keepdims=True)
    n_statistic = nominal.shape[1]
    changed = np.zeros((*same.shape, len(SHIFTS)))
    left, begun = np.ones(n_statistic), np.zeros(n_statistic)  # weight of later changes; sessions so far
    found = np.ones((len(watched), n_statistic))
    place = grid.place[..., None] + SHIFTS * grid.scale[..., None]
    scale = np.sqrt(1.0 + (SHIFTS / WIDENING) ** 2) * grid.scale[..., None]
    for session, row in enumerate(watched):
        begun += np.isfinite(row)
        weight = np.where(np.isfinite(row), start_weight(begun), 0.0)
        left = left - weight
        begins = (weight[:, None, None] / len(SHIFTS) * same)[..., None]
        unchanged = _density(row, grid.place, grid.scale)
        most = MOST_OF_ONE * unchanged[..., None]
        changed = (changed + begins) * np.minimum(_density(row, place, scale), most)
        same = same * unchanged
        total = same.sum(axis=(1, 2))
        ratio = changed.sum(axis=(1, 2, 3)) / np.maximum(total, 1e-300)
        found[session] = np.minimum(ratio + left, LARGEST)
        largest = np.maximum(same.max(axis=(1, 2)), changed.max(axis=(1, 2, 3)))
        same = same / largest[:, None, None]
        changed = changed / largest[:, None, None, None]
    return found


def start_weight(session: np.ndarray) -> np.ndarray:
    """w_v of a change from session v = 1, 2, … on; all together they are 1."""
    return (1.0 + HALF_LIFE) / ((session + HALF_LIFE) * (session + HALF_LIFE + 1.0))


def _density(row: np.ndarray, place: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Student's t of each statistic at the nodes, but for a constant; 1 where it says nothing."""
    is_told = np.isfinite(row)
    along = (slice(None), *([None] * (place.ndim - 1)))
    share = (np.where(is_told, row, 0.0)[along] - place) / scale
    tail = 1.0 + share * share / DEGREES
    return np.where(is_told[along], 1.0 / (tail * tail * tail * scale), 1.0)  # to the power -(5 + 1) / 2
