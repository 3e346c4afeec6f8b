"""Which commands of measured logs the nominal logs hold."""

import numpy as np
import pytest

from pipeline.discrepancy.diagnosis.training_support import is_often, uncovered_share


def test_commands_between_those_of_nominal_logs_are_not_covered():
    random = np.random.default_rng(1)
    small, full = random.uniform(0.0, 0.3, (500, 2)), np.ones((500, 2))
    nominal = random.choice([-1.0, 1.0], (1000, 1)) * np.concatenate([small, full])
    between = np.stack([np.full(400, 0.6), np.full(400, 0.15)], axis=1)
    at_rest = np.zeros((300, 2))
    covered = np.concatenate([np.ones((100, 2)), at_rest])
    shares = uncovered_share(nominal, np.concatenate([between, covered]))
    assert shares == pytest.approx([0.8, 0.0])


def test_a_joint_that_is_never_commanded_asks_for_nothing():
    assert uncovered_share(np.ones((10, 1)), np.zeros((10, 1))) == pytest.approx([0.0])


def test_where_nominal_logs_command_nothing_all_is_uncovered():
    assert uncovered_share(np.zeros((10, 1)), np.ones((10, 1))) == pytest.approx([1.0])


def test_commands_in_steps_of_a_tenth_fall_into_the_same_part_whatever_their_rounding():
    steps = np.arange(-10, 11) / 10.0
    nominal, measured = np.repeat(steps, 5)[:, None], np.float32(steps)[:, None] + 1e-8
    assert uncovered_share(nominal, measured) == pytest.approx([0.0])
    assert uncovered_share(np.full((50, 1), 0.3), np.full((9, 1), 0.34)) == pytest.approx([0.0])
    assert uncovered_share(np.full((50, 1), 0.3), np.full((9, 1), 0.29)) == pytest.approx([1.0])


def test_what_lies_beyond_the_range_belongs_to_its_ends():
    edges = np.linspace(0.0, 1.0, 5)
    known = np.array([-0.5, 0.1, 0.3, 1.0, 2.0])
    np.testing.assert_array_equal(
        is_often(known, np.array([-3.0, 0.2, 0.3, 0.6, 0.8, 9.0]), edges, 0.4),
        [True, True, False, False, True, True],
    )
    assert not is_often(np.zeros(0), np.array([0.5]), edges, 0.4).any()
