"""The graph's clock: the host's monotonic clock plus an offset that a parameter of the graph's master holds.

A step of the wall clock moves nothing, and whoever joins the graph later has the same time. The parameter is text,
as ROS's XML-RPC carries integers of 32 bits only.
"""

import time
import xmlrpc.client
from typing import Any

from pipeline.errors import InputError

PARAMETER = "/graph_clock_offset_ns"
CALLER = "/launch"


class GraphClock:
    """Time of the graph that this process has joined."""

    def __init__(self, rospy: Any) -> None:
        """Asks the master of an initialised node.

        Raises:
            InputError: it was not launched with a clock.
        """
        try:
            self._offset_ns = int(rospy.get_param(PARAMETER))
        except (KeyError, ValueError):
            raise InputError(
                f"the ROS master holds no parameter {PARAMETER}; launch the graph with run_graph or reaching.launch"
            ) from None

    def now_ns(self) -> int:
        """Nanoseconds since the epoch, as they were when the graph was launched, counted on monotonically."""
        return time.monotonic_ns() + self._offset_ns


def set_clock(master_uri: str) -> None:
    """Begin the graph's time: now, by the wall clock."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    xmlrpc.client.ServerProxy(master_uri).setParam(CALLER, PARAMETER, str(offset_ns))
