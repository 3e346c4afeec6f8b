"""A controller drives its model through the graph in simulated time, and is judged as in Brax (Sim2Sim)."""

import os
from collections.abc import Callable
from typing import Any

from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.compose import GraphSettings, controller_delays
from pipeline.deployment.transports.simulated_time.delays import lengthened
from pipeline.deployment.trials import GraphParts, run_episodes
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.logged_trials import trial_traces
from pipeline.reaching.metrics import Traces, reaching_metrics


def evaluate_in_graph(
    settings: GraphSettings,
    parts: GraphParts,
    episodes: Episodes,
    progress: Callable[[int], None],
    extra_delay_s: float = 0.0,
) -> tuple[Traces, dict[str, Any]]:
    """Run every episode through a graph of its own, with the delays that were measured.

    Args:
        settings: What the parts are composed of.
        episodes: Starts and targets.
        progress: Called with the number of episodes done.
        extra_delay_s: By which the loop takes longer than measured, s.

    Returns:
        Traces of all episodes, and their metrics without returns: logs of the graph hold no rewards.
    """
    # what a planner computes leaves Python to the other threads; a policy's decisions are too short for that
    threads = len(os.sched_getaffinity(0)) if settings.kind is ControllerKind.icem else 1
    delays = lengthened(controller_delays(settings), extra_delay_s)
    trials = run_episodes(parts, delays, episodes, progress, threads)
    traces = trial_traces(trials, settings.machine, parts.task.arm)
    metrics = reaching_metrics(traces, parts.task.arm.surfaces).as_dict()
    del metrics["average_return"]
    return traces, metrics
