"""The posterior on residuals that are made of columns, so that the truth is known."""

from collections.abc import Mapping

import numpy as np
import pytest

from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence
from pipeline.discrepancy.posterior.evidence.nominal_joint import Rows
from pipeline.discrepancy.posterior.explanations import COURSE, SUPPLY, Explanation, Posterior
from pipeline.discrepancy.posterior.residual.columns import Columns, Term
from pipeline.discrepancy.posterior.residual.rows import MOVING, RowFacts

N_JOINT, N_ROW, N_SESSION, N_MEMBER = 2, 2400, 2, 4
FREED = ((("ratio_positive", None),),)
SESSION = np.repeat(np.arange(N_SESSION), N_ROW // N_SESSION)
STAMP_NS = 1_750_000_000_000_000_000 + (np.arange(N_ROW) * 100_000_000 + SESSION * 3_600_000_000_000)
DELAYS = (0.05, 0.1, 0.2)
FAMILIES = ("gain", "delay", "other:velocity")


def terms() -> list[Term]:
    """Of each joint a gain, delays, and a dependence."""
    result = []
    for joint in range(N_JOINT):
        result.append(Term("gain", joint, None, {}, FREED, (0,), (0.0,), (0.18,), (-0.8,), (1.0,)))
        for column, delay in enumerate(DELAYS, start=1):
            of = {"added_delay": delay}
            result.append(Term("delay", joint, None, of, (), (column,), (1.0,), (0.25,), (0.0,), (2.0,)))
        wide = (-2.0,) * 2, (2.0,) * 2
        result.append(
            Term("other:velocity", joint, None, {}, FREED * 2, (4, 5), (0.0,) * 2, (0.4,) * 2, *wide)
        )
    return result


def rows(seed: int, true: Mapping[tuple[int, int], float], since: int = 0) -> Rows:
    """Logs with coefficients of columns, by joint and column, from a row on, and noise of 0.02."""
    random = np.random.default_rng(seed)
    matrices = []
    for _ in range(N_JOINT):
        columns = random.standard_normal((N_ROW, 6)) * 0.1
        columns[:, 2] = 2.0 * columns[:, 1] + 0.01 * random.standard_normal(N_ROW)  # a longer delay does more
        columns[:, 3] = 4.0 * columns[:, 1] + 0.02 * random.standard_normal(N_ROW)
        matrices.append(columns.astype(np.float32))
    residual = 0.02 * random.standard_normal((N_ROW, N_JOINT))
    for (joint, column), value in true.items():
        residual[since:, joint] += value * matrices[joint][since:, column]
    state = np.full((N_ROW, N_JOINT), MOVING)
    facts = RowFacts(SESSION, SESSION, STAMP_NS, state)
    velocity = np.full((N_ROW, N_JOINT), 0.2)
    none = np.zeros((N_ROW, N_JOINT, N_MEMBER))
    return Rows(Columns(residual, matrices, terms()), facts, velocity, np.ones((N_ROW, N_JOINT)), none)


def explained(true: Mapping[tuple[int, int], float], since: int = 0) -> list[Explanation]:
    nominal, measured = rows(1, {}), rows(2, true, since)
    joints = [JointEvidence(joint, nominal, measured) for joint in range(N_JOINT)]
    return Posterior(joints, FAMILIES).explanations()


def test_nothing_is_most_probable_where_nothing_is() -> None:
    explanations = explained({})
    assert explanations[0].causes == ()
    assert explanations[0].probability > 0.9
    assert sum(of.probability for of in explanations) == pytest.approx(1.0)


def test_two_effects_are_found_with_their_joints() -> None:
    explanations = explained({(0, 0): -0.3, (1, 2): 1.0})
    found = {(cause.family, cause.joints) for cause in explanations[0].causes}
    assert found == {("gain", (0,)), ("delay", (1,))}
    assert explanations[0].probability > 0.95


def test_what_sets_in_is_found_with_its_moment() -> None:
    since = 1700
    (cause,) = explained({(0, 0): -0.3}, since)[0].causes
    assert (cause.family, cause.sets_in) == ("gain", True)
    joint = JointEvidence(0, rows(1, {}), rows(2, {(0, 0): -0.3}, since))
    joint.let_set_in([0], joint.moments())
    onset = joint.onsets[cause.terms[0]]
    assert onset is not None
    assert abs(onset - STAMP_NS[since]) < 11e9


def test_a_joint_that_never_counts_tells_nothing() -> None:
    nominal, measured = (
        of._replace(weight=np.array([1.0, 0.0]) * of.weight)
        for of in (rows(1, {}), rows(2, {(0, 0): -0.3, (1, 0): -0.3}))
    )
    joints = [JointEvidence(joint, nominal, measured) for joint in range(N_JOINT)]
    (cause,) = Posterior(joints, FAMILIES).explanations()[0].causes
    assert (cause.family, cause.joints) == ("gain", (0,))


def test_slow_variations_are_told_unless_they_are_excluded() -> None:
    nominal, measured = rows(1, {}), rows(2, {})

    def told(excluded: list[str]) -> set[str]:
        joints = [JointEvidence(joint, nominal, measured) for joint in range(N_JOINT)]
        explanations = Posterior(joints, FAMILIES, excluded).explanations()
        return {cause.family for of in explanations for cause in of.causes} & {SUPPLY, COURSE}

    assert told([]) == {SUPPLY, COURSE}
    assert told([SUPPLY]) == {COURSE}


def test_what_every_session_shows_is_no_effect() -> None:
    """The model misses the same in nominal sessions: it hides no effect beside it either."""
    misfit = {(0, 4): 0.3}
    nominal = rows(1, misfit)

    def best(true: Mapping[tuple[int, int], float]) -> set[tuple]:
        joints = [JointEvidence(joint, nominal, rows(2, true)) for joint in range(N_JOINT)]
        (first, *_) = Posterior(joints, FAMILIES).explanations()
        return {(cause.family, cause.joints) for cause in first.causes}

    assert best(misfit) == set()
    assert best({(0, 4): 0.9}) == {("other:velocity", (0,))}


def test_where_members_of_the_model_differ_it_may_be_as_far_off() -> None:
    """The machine is one more member: what it differs by looks like an effect beside the noise alone."""
    nominal, measured = rows(1, {}), rows(2, {(0, 0): -0.3})
    off = measured.columns.matrices[0][:, 0]
    spread = np.zeros((N_ROW, N_JOINT, N_MEMBER))
    spread[:, 0] = off[:, None] * np.array([0.4, -0.2, 0.1, -0.3])

    def best(of: np.ndarray) -> list[str]:
        joints = [JointEvidence(joint, nominal, measured._replace(spread=of)) for joint in range(N_JOINT)]
        return [cause.family for cause in Posterior(joints, FAMILIES).explanations()[0].causes]

    assert best(0.0 * spread) == ["gain"]
    assert best(spread) == []


@pytest.mark.parametrize(("beside", "families"), [(0.05, {"gain"}), (0.6, {"gain", "other:velocity"})])
def test_what_a_card_lacks_is_no_second_effect(beside: float, families: set[str]) -> None:
    """A tenth of an effect is within what its card may be off, though beside the noise it is certain."""
    explanations = explained({(0, 0): -0.7, (0, 4): beside, (0, 5): beside})
    assert {cause.family for cause in explanations[0].causes} == families
