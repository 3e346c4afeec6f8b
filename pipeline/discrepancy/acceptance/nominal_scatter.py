"""What logs that are without an effect ask for of it: by how much a size scatters where there is none.

It would be zero, were the diagnosis model right. Where it is not, measured logs that visit the same places more often
show more of the same misfit, but none of another size. A small change that many rows show is beyond chance where it is
but that misfit, so a size is compared with these and not with the noise.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS, nominal_parts
from pipeline.discrepancy.acceptance.shown import Deviation, Shown


class Scatter(NamedTuple):
    """Of a size, where there is no effect.

    Attributes:
        share: Of the effect's size; root mean square over parts of the nominal logs.
        squares: Of what the effect changes on one part.
    """

    share: float
    squares: float

    def on(self, squares: float) -> Deviation:
        """On rows on which the effect changes so much.

        Rows that show less of it scatter more; those that show more scatter no less, as misfit is no noise.
        """
        less = max(self.squares / max(squares, 1e-12), 1.0)
        return Deviation(self.share * float(np.sqrt(less)), MISFIT_PARTS)


def nominal_scatter(nominal: Shown, squares_per_row: float) -> Scatter:
    """By parts of the nominal logs.

    Args:
        nominal: What an effect changes there.
        squares_per_row: Of what an effect of size one changes. Of all rows, not of the part: a part that hardly shows
            the effect says little, not anything.
    """
    squares = squares_per_row * len(nominal.change) / MISFIT_PARTS
    products = np.sum(nominal.change * nominal.residual, axis=1)
    asked = np.bincount(nominal_parts(len(products)), products, MISFIT_PARTS)
    return Scatter(float(np.sqrt(np.mean((asked / max(squares, 1e-12)) ** 2))), squares)
