"""The graph's clock: the host's monotonic clock plus an offset that a parameter of the graph's master holds.

Steps of the wall clock have no effect, and processes that join later have the same time. The parameter is text, as
ROS's XML-RPC transports integers of 32 bits only.
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
            InputError: the graph was launched without a clock.
        """
        try:
            self._offset_ns = int(rospy.get_param(PARAMETER))
        except (KeyError, ValueError):
            raise InputError(
                f"the ROS master holds no parameter {PARAMETER}; launch the graph with run_graph or reaching.launch"
            ) from None

    def now_ns(self) -> int:
        """Nanoseconds since the epoch at the graph's launch, plus the monotonic time since."""
        return time.monotonic_ns() + self._offset_ns


def set_clock(master_uri: str) -> None:
    """Start the graph's clock at the present wall-clock time."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    xmlrpc.client.ServerProxy(master_uri).setParam(CALLER, PARAMETER, str(offset_ns))
