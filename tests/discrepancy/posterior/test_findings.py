"""What explanations are told as: effects with their probability, their rivals, and what confirmation rows say."""

import numpy as np
import pytest

from pipeline.discrepancy.posterior.e_values import log_e_value
from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence
from pipeline.discrepancy.posterior.evidence.nominal_joint import Rows
from pipeline.discrepancy.posterior.explanations import Cause, Explanation, Posterior
from pipeline.discrepancy.posterior.findings import (
    findings_of,
    probability_of,
    probability_of_none,
    rivals_of,
)
from pipeline.discrepancy.posterior.new_rows import on_all_rows
from pipeline.discrepancy.posterior.power import visible_sizes
from tests.discrepancy.posterior.test_explanations import FAMILIES, N_JOINT, rows

TRUE = {(0, 0): -0.3}


def cause(family: str, *joints: int, sets_in: bool = False) -> Cause:
    return Cause(family, None, dict.fromkeys(joints, 0), joints, sets_in, 0.0)


def explanation(probability: float, *causes: Cause) -> Explanation:
    return Explanation(causes, probability, 0.0, 0.0)


def test_beside_a_dependence_no_name_is_told_on_its_joint() -> None:
    told = findings_of([cause("backlash", 0), cause("other:reversal", 0), cause("gain", 1)])
    assert [(of.family, of.joints) for of in told] == [("other", {0}), ("gain", {1})]


def test_an_effect_is_as_probable_as_the_explanations_that_have_it() -> None:
    gain, delay, lag = cause("gain", 0), cause("delay", 1), cause("lag", 0)
    all_of_them = [explanation(0.6, gain, delay), explanation(0.3, lag), explanation(0.1)]
    found = findings_of([gain])[0]
    assert probability_of(found, all_of_them) == pytest.approx(0.6)
    assert probability_of_none(all_of_them) == pytest.approx(0.1)
    assert [rival.family for rival, _, _ in rivals_of(found, all_of_them, 0.8)] == ["lag"]
    assert rivals_of(found, all_of_them, 0.6) == []


@pytest.fixture(scope="module")
def fitted() -> list[JointEvidence]:
    """Joints with the true effect."""
    return [JointEvidence(joint, rows(1, {}), rows(2, TRUE)) for joint in range(N_JOINT)]


@pytest.fixture(scope="module")
def explanations(fitted: list[JointEvidence]) -> list[Explanation]:
    """Of their logs."""
    return Posterior(fitted, FAMILIES).explanations()


def left_by(true: dict[tuple[int, int], float], of: Rows) -> np.ndarray:
    """Residual in the presence of true effects."""
    residual = of.columns.residual.copy()
    for (joint, column), value in true.items():
        residual[:, joint] -= value * of.columns.matrices[joint][:, column]
    return residual


def test_new_rows_bear_out_the_true_cause_and_no_other(
    fitted: list[JointEvidence], explanations: list[Explanation]
) -> None:
    new = rows(3, TRUE)
    held_out = [joint.on(new) for joint in fitted]
    (found,) = findings_of(explanations[0].causes)
    assert found.family == "gain"
    of_found = log_e_value(found, explanations[0], fitted, held_out, left_by(TRUE, new))
    assert of_found > np.log(20.0)
    assert probability_of(found, on_all_rows(explanations, fitted, held_out)) > 0.99
    wrong = next(of for of in explanations if [c.family for c in of.causes] == ["delay"])
    (of_wrong,) = findings_of(wrong.causes)
    assert log_e_value(of_wrong, wrong, fitted, held_out, left_by({}, new)) < 0.0


def test_new_rows_without_an_effect_bear_out_none(
    fitted: list[JointEvidence], explanations: list[Explanation]
) -> None:
    new = rows(3, {})
    held_out = [joint.on(new) for joint in fitted]
    (found,) = findings_of(explanations[0].causes)
    assert log_e_value(found, explanations[0], fitted, held_out, left_by(TRUE, new)) < 0.0
    assert probability_of_none(on_all_rows(explanations, fitted, held_out)) > 0.5


def test_an_effect_of_visible_size_is_found() -> None:
    odds = float(np.log(0.95 / 0.05))

    def of_none(size: float, seed: int) -> float:
        joint = JointEvidence(0, rows(1, {}), rows(seed, {(0, 0): -size}))
        return probability_of_none(Posterior([joint], FAMILIES).explanations())

    nothing = JointEvidence(0, rows(1, {}), rows(2, {}))
    (gain,) = visible_sizes(nothing, ["gain"], float(-np.log(6.0)), odds)
    assert gain.unit == "1"
    # 0.9 is told: of three, fewer than two are found with probability 0.03; of half the size hardly any.
    assert sum(of_none(gain.size, seed) < 0.05 for seed in range(10, 13)) >= 2
    assert sum(of_none(0.5 * gain.size, seed) < 0.05 for seed in range(10, 13)) <= 1
