"""What the speed of PPO's environment is measured against computes the same."""

import numpy as np
import pytest

from benchmarks.ppo_speed import check_equal, environments_of, operations


@pytest.mark.long
def test_the_plain_environment_is_the_same_task():
    check_equal(*environments_of([16, 8]))


def test_operations_are_two_per_weight():
    assert operations([156, 512, 128, 4]) == 2 * (156 * 512 + 512 * 128 + 128 * 4)
    assert np.isclose(operations([3, 2]), 12.0)
