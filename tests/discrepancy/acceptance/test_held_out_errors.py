"""Windows on confirmation rows against a search by hand."""

import numpy as np
import pytest

from pipeline.discrepancy.acceptance.held_out_errors import WindowErrors
from pipeline.discrepancy.diagnosis.window_starts import starts_within


@pytest.mark.parametrize("horizon", [1, 80, 1000])
def test_starts_are_the_contracts_and_lie_within(horizon: int) -> None:
    allowed = np.zeros(3000, bool)
    allowed[100:1500] = True
    allowed[1600:2950] = True
    step = 1 if horizon == 1 else 20
    expected = [s for s in range(40, 3000 - horizon, step) if allowed[s : s + horizon + 1].all()]
    assert starts_within(allowed, horizon).tolist() == expected


def test_rmse_and_interval() -> None:
    squares = np.array([[1.0, 4.0], [3.0, 4.0]])
    errors = WindowErrors(squares, np.array([0, 1]))
    np.testing.assert_allclose(errors.rmse, [np.sqrt(2.0), 2.0])
    low, high = errors.interval()
    assert low[0] == pytest.approx(1.0)
    assert high[0] == pytest.approx(np.sqrt(3.0))
    assert low[1] == high[1] == pytest.approx(2.0)
    nothing = WindowErrors(np.zeros((0, 2)), np.zeros(0, int))
    assert np.isnan(nothing.rmse).all()
