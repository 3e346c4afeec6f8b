"""What a stage says of a graph that does not come up."""

import itertools

import pytest

from pipeline.deployment.ros1.listener import wait_until_up
from pipeline.errors import InputError


def test_a_node_that_ended_is_no_time_out() -> None:
    with pytest.raises(InputError, match="a node ended while the graph came up"):
        wait_until_up(lambda: False, "4 nodes", 300.0, is_running=lambda: False)
    with pytest.raises(InputError, match="4 nodes did not come up within"):
        wait_until_up(lambda: False, "4 nodes", 0.01, is_running=lambda: True)


def test_waiting_ends_once_it_is_there() -> None:
    tries = itertools.count()
    wait_until_up(lambda: next(tries) == 2, "4 nodes", 300.0, is_running=lambda: True)
    assert next(tries) == 3
