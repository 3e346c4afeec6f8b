"""The machine never repeats itself exactly: how much of every column varies from session to session without a cause.

    r_s = B (m + b_s) + noise,     b_s ~ N(0, diag(a_f² w² + τ u²))   anew in every session

B holds columns of every family, of usual size w, and slow variations of speed. What the model misses in every session
alike, m, is no scatter: it is fitted to all nominal logs. The size a_f of each family is that of greatest likelihood on
parts of the nominal logs as long as a session, each with an m of the other parts. With u all families together make up
the squares of the nominal residual. τ is the share of these that is not worth a name, however surely it is there.

Source: variance components by type-II likelihood with fixed-point updates, MacKay (1992), Bayesian interpolation; as
model discrepancy: Kennedy and O'Hagan (2001).
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.families.plausibility import TIMING
from pipeline.discrepancy.posterior.residual.columns import Term
from pipeline.effects.catalogue import KNOWN

FAMILY_OF_SPEED = "speed in time"
GRID_POINTS = 4  # of a family with linear parameters: neighbours are much alike
UPDATES = 30
FIRST_SIZE, LARGEST_SIZE = 0.05, 5.0
SMALLEST_NOISE = 0.2


class Basis(NamedTuple):
    """Columns of what varies.

    Attributes:
        columns: (K,) indices.
        families: (K,) names.
        scale: (K,) standard deviation of the coefficients at size one.
    """

    columns: np.ndarray
    families: tuple[str, ...]
    scale: np.ndarray


def basis_of(terms: Sequence[Term], speed_columns: np.ndarray, speed_scale: np.ndarray) -> Basis:
    """A few columns of every family, and the slow variations of speed."""
    scale_of: dict[int, tuple[str, float]] = {}
    groups: dict[tuple[str, int | None], list[Term]] = defaultdict(list)
    for term in terms:
        groups[term.family, term.source].append(term)
    for (family, _), of_family in groups.items():
        if family == TIMING:  # whose columns are those of delays
            continue
        chosen = _linear(of_family) if of_family[0].freed else _at_small_sizes(of_family)
        scale_of.update({column: (family, scale) for column, scale in chosen.items()})
    columns = sorted(scale_of)
    families = tuple(scale_of[column][0] for column in columns)
    return Basis(
        np.concatenate([np.array(columns, int), speed_columns]),
        families + (FAMILY_OF_SPEED,) * len(speed_columns),
        np.concatenate([[scale_of[column][1] for column in columns], speed_scale]),
    )


def _linear(terms: Sequence[Term]) -> dict[int, float]:
    points = list(dict.fromkeys(tuple(sorted(term.point.items())) for term in terms))
    kept = np.unique(np.linspace(0, len(points) - 1, min(GRID_POINTS, len(points))).round().astype(int))
    of_points = {points[index] for index in kept}
    share = 1.0 / np.sqrt(len(of_points))
    return {
        column: share * scale
        for term in terms
        if tuple(sorted(term.point.items())) in of_points
        for column, scale in zip(term.columns, term.scale, strict=True)
    }


def _at_small_sizes(terms: Sequence[Term]) -> dict[int, float]:
    """Points of the smallest and of the middle size, scaled up to the usual one: small effects are linear in it."""
    rays: dict[tuple, list[tuple[float, Term]]] = defaultdict(list)
    for term in terms:
        (name, value), *rest = term.point.items()
        size = value - _neutral(term.family, name)
        rays[name, tuple(rest), np.sign(size)].append((abs(size), term))
    chosen = {}
    for ray in rays.values():
        ray.sort(key=lambda of: of[0])
        usual = np.sqrt(np.mean([size**2 for size, _ in ray]))
        for index in {0, len(ray) // 2}:
            size, term = ray[index]
            if size > 0.0:
                chosen[term.columns[0]] = float(usual / size / np.sqrt(2.0 * len(rays)))
    return chosen


def _neutral(family: str, name: str) -> float:
    return next(p.neutral for p in KNOWN[family].card.parameters if p.name == name)


def learn_sizes(
    grams: Sequence[np.ndarray], n_rows: Sequence[int], families: Sequence[str]
) -> Mapping[str, float]:
    """Squared size of each family.

    Args:
        grams: Per nominal part (K + 1, K + 1), products of the scaled columns and of the residual, whitened.
        n_rows: Of each part.
        families: (K,).
    """
    names = sorted(set(families))
    index = np.array([names.index(family) for family in families])
    k, square, noise = len(families), np.full(len(names), FIRST_SIZE**2), 1.0
    for _ in range(UPDATES):
        of_means, of_known = np.zeros((2, len(names)))
        left, known_in_all = 0.0, 0.0
        root = np.sqrt(square[index])
        for gram in grams:
            precision = np.eye(k) + root[:, None] * gram[:k, :k] / noise * root
            variance = np.linalg.inv(precision)
            mean = root * (variance @ (root * gram[:k, k] / noise))
            known = 1.0 - np.diag(variance)
            of_means += np.bincount(index, mean**2, len(names))
            of_known += np.bincount(index, known, len(names))
            left += gram[k, k] - 2.0 * mean @ gram[:k, k] + mean @ gram[:k, :k] @ mean
            known_in_all += known.sum()
        update = np.clip((of_means + 1e-6) / (of_known + 1e-4), 0.1 * square, 10.0 * square)
        square = np.clip(
            np.sqrt(square * update), 1e-6, LARGEST_SIZE**2
        )  # half a step, as it oscillates otherwise
        noise = max(left / max(sum(n_rows) - known_in_all, 1.0), SMALLEST_NOISE)
    return dict(zip(names, square.tolist(), strict=True))


def common_misfit(gram: np.ndarray, squared_sizes: np.ndarray) -> np.ndarray:
    """(K,) most probable coefficients of what all parts have in common, in units of the scaled columns.

    Args:
        gram: (K + 1, K + 1) of all parts together, as of `learn_sizes`.
        squared_sizes: (K,).
    """
    k, root = len(squared_sizes), np.sqrt(squared_sizes)
    precision = np.eye(k) + root[:, None] * gram[:k, :k] * root
    return np.asarray(root * np.linalg.solve(precision, root * gram[:k, k]))


def less_misfit(gram: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """(K + 1, K + 1) products of a part when a misfit (K,) is taken out of its residual."""
    change = np.eye(len(gram))
    change[:-1, -1] = -misfit
    return np.asarray(change.T @ gram @ change)
