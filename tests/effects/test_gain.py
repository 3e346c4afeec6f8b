"""Gain: one ratio per direction of motion."""

import numpy as np
import pytest

from pipeline.effects.gain import Gain

from .conftest import SETTING, respond

pytestmark = pytest.mark.usefixtures("float64")


def test_each_direction_has_its_ratio():
    values = {"ratio_positive": np.array([1.5, 1.0]), "ratio_negative": np.array([0.5, 0.8])}
    v = respond(Gain(SETTING), values, np.array([[0.2, 0.1], [-0.2, -0.1], [0.0, 0.0]]))
    np.testing.assert_allclose(v, [[0.3, 0.1], [-0.1, -0.08], [0.0, 0.0]], rtol=1e-12)


def test_variants_free_one_direction_or_both_together_or_apart():
    positive, negative = ("ratio_positive", None), ("ratio_negative", None)
    assert Gain(SETTING).variants() == [
        ((positive,),),
        ((negative,),),
        ((positive, negative),),
        ((positive,), (negative,)),
    ]
