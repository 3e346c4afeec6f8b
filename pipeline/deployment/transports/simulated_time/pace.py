"""Simulated time slowed down to real time, for viewers."""

import time

from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph

SLICE_NS = nanoseconds(0.02)


def run_at_real_time(graph: SimulatedGraph, until_ns: int) -> None:
    """Run the graph at real time; lateness is caught up."""
    ahead_ns = graph.time_ns - time.monotonic_ns()
    while graph.time_ns < until_ns:
        graph.run(min(graph.time_ns + SLICE_NS, until_ns))
        wait_ns = graph.time_ns - time.monotonic_ns() - ahead_ns
        if wait_ns > 0:
            time.sleep(wait_ns / NANOSECONDS)
