"""What a signature is drawn over: the direction of the last change of a command, and the time since."""

import numpy as np

from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.verdict.signature import LONGEST_SINCE_S, last_change, since_change_s

COMMAND = np.array([[0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0, 1.0, 0.5, 0.0]])


def test_a_start_counts_in_its_direction_and_a_stop_against_it():
    np.testing.assert_array_equal(last_change(COMMAND), [[0, 0, 1, 1, -1, -1, -1, 1, 1, -1]])


def test_time_counts_from_each_change_of_sign():
    n = 200
    command = np.zeros((1, n, 1))
    command[0, :10, 0] = COMMAND[0]
    fields = dict.fromkeys(Sequences._fields, np.zeros((1, n, 1)))
    fields |= {
        "command": command,
        "time_s": 0.05 * np.arange(n)[None],
        "is_row": np.ones((1, n), bool),
    }
    since_s = since_change_s(Sequences(**fields), 0)
    np.testing.assert_allclose(since_s[0, 2:10], 0.05 * np.array([0, 1, 0, 1, 0, 0, 1, 0]))
    assert since_s.max() == LONGEST_SINCE_S
