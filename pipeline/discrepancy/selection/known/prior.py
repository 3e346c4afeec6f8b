"""What an earlier run found of effects, as a normal prior of the values that a fit chooses anew.

The fit minimises squares in units of the noise floor as if rows were independent. Of rows that follow one another so
many count as one; the prior weighs as many times more, so that both are weighed as their variances ask.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.selection.free_parameters import Column, Coordinate, value_of
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


def name_of(coordinate: Coordinate) -> str:
    """Of a value among `Known.deviations`."""
    return coordinate.name or f"coefficient:{coordinate.index}"


def prior_rows(
    found: Sequence[SelectedEffect], columns: Sequence[Column]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows that a fit's squares get beside those of the logs.

    Args:
        found: All effects.
        columns: What the fit moves.

    Returns:
        (n, k) derivatives; (n,) how far each value is from what it was, in the same units; (n,) rows that count as one.
    """
    derivatives, distances, correlated = [], [], []
    for place, column in enumerate(columns):
        for coordinate in column:
            known = found[coordinate.effect].known
            deviation = 0.0 if known is None else known.deviations.get(name_of(coordinate), 0.0)
            if known is None or deviation <= 0.0:
                continue
            weight = np.sqrt(known.correlated) / deviation
            derivatives.append(weight * np.eye(len(columns))[place])
            distances.append(
                weight * (known.value_of(coordinate.name, coordinate.index) - value_of(found, coordinate))
            )
            correlated.append(known.correlated)
    return np.reshape(derivatives, (-1, len(columns))), np.array(distances), np.array(correlated)
