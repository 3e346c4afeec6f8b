"""E-values of effects, by what confirmation rows and nominal logs ask for."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from pipeline.discrepancy.acceptance import e_value as judging
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.size_of_an_effect import Asked
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from tests.discrepancy.bare_candidate import bare_candidate


@pytest.mark.parametrize("p_value", [1e-12, 1e-3, 0.05, 0.5, 0.99])
def test_it_is_the_mean_over_all_powers(p_value: float) -> None:
    mean, _ = quad(lambda kappa: kappa * p_value ** (kappa - 1.0), 0.0, 1.0)
    assert judging.e_value_of(p_value) == pytest.approx(mean, rel=1e-6)


def test_it_is_one_on_average_where_there_is_no_effect() -> None:
    """Over p-values that are as probable as they say; beyond e⁻⁶⁰⁰ the integral has 1 / 600 left."""
    mean, _ = quad(lambda u: judging.e_value_of(np.exp(-u)) * np.exp(-u), 1e-3, 600.0, limit=500)
    assert mean == pytest.approx(1.0, abs=0.005)
    assert judging.as_told(judging.e_value_of(1.0)) == {"e_value": 0.5, "p_value": 1.0}


def test_nominal_logs_scatter_is_the_null(monkeypatch) -> None:
    """Sizes that are drawn as those of nominal parts are: small p-values are as seldom as they say."""
    random, n_rows, n_draws = np.random.default_rng(0), 400, 2000
    effect = SelectedEffect(bare_candidate("gain", 0))
    change = random.standard_normal((n_rows, 1))
    diagnosis: Any = SimpleNamespace(
        nominal=None, simulation=None, held_out=SimpleNamespace(floor=np.ones(1))
    )
    fit = FittedEffects(diagnosis, [effect], [MachineEffect("gain", [effect])])
    p_values = []
    for _ in range(n_draws):
        drawn = random.normal(0.0, 0.3, 1 + judging.MISFIT_PARTS)
        of_measured, of_nominal = drawn[0] * change, np.sqrt(np.mean(drawn[1:] ** 2))
        monkeypatch.setattr(
            judging, "residual_of", lambda _, __, found, of=of_measured: of - change if found else of
        )
        asked = Asked(float(of_nominal), squares=float(np.sum(change**2)))
        monkeypatch.setattr(judging, "asked_for_on_nominal", lambda *_, of=asked: of)
        p_values.append(judging.p_on_confirmation_rows(fit, fit.effects[0], [effect]))
    for level in (0.01, 0.05, 0.2):
        assert np.mean(np.array(p_values) < level) == pytest.approx(level, abs=3 * np.sqrt(level / n_draws))
