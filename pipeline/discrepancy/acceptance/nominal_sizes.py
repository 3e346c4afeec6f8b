"""What logs that are without an effect ask for of it: which sizes are usual where there is none.

They would be zero, were the diagnosis model right. Where it is not, a small change that many rows show is beyond
chance, and still but misfit. So a size is compared with these, and not with the noise.
"""

from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS, nominal_parts
from pipeline.discrepancy.acceptance.shown import Deviation, Shown


class NominalSizes(NamedTuple):
    """Of an effect, in units of the fitted one.

    Attributes:
        usual: Their mean over parts of the nominal logs, or zero if that is negative: what the model is off by in one
            direction is no evidence for an effect in the other.
        deviation: Of a further one from it.
        squares: Of what the effect changes on one part.
    """

    usual: float
    deviation: Deviation
    squares: float

    def deviation_on(self, squares: float) -> Deviation:
        """On rows on which the effect changes so much.

        Rows that show less of it scatter more; those that show more scatter no less, as misfit is no noise.
        """
        less = max(self.squares / max(squares, 1e-12), 1.0)
        return self.deviation._replace(value=self.deviation.value * float(np.sqrt(less)))


def nominal_sizes(nominal: Shown, squares_per_row: float) -> NominalSizes:
    """By parts of the nominal logs.

    Args:
        nominal: What an effect changes there.
        squares_per_row: Of what an effect of size one changes. Of all rows, not of the part: a part that hardly shows
            the effect says little, not anything.
    """
    squares = squares_per_row * len(nominal.change) / MISFIT_PARTS
    products = np.sum(nominal.change * nominal.residual, axis=1)
    asked = np.bincount(nominal_parts(len(products)), products, MISFIT_PARTS) / max(squares, 1e-12)
    usual = max(float(asked.mean()), 0.0)
    n_fitted = int(usual > 0.0)  # as a t-test's mean, which is known no better than that
    freedom = MISFIT_PARTS - n_fitted
    variance = np.sum((asked - usual) ** 2) / freedom * (1.0 + n_fitted / MISFIT_PARTS)
    return NominalSizes(usual, Deviation(float(np.sqrt(variance)), freedom), squares)
