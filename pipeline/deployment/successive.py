"""Successive targets on one machine, as in the paper's tests on the excavator (section "Sim2Real transfer")."""

from collections.abc import Callable, Mapping

import numpy as np

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.goals import compiled_forward
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.machine import Machine
from pipeline.deployment.messages import ReachGoal, Topic
from pipeline.deployment.transports.simulated_time.delays import Distribution
from pipeline.deployment.transports.simulated_time.graph import SimulatedGraph
from pipeline.deployment.trials import SAFETY_FACTOR, GraphParts


def run_successive(
    parts: GraphParts,
    delays: Mapping[str, Distribution],
    machine: Machine,
    estimator: VelocityEstimator | None,
    targets: np.ndarray,
    start_ns: int,
    progress: Callable[[int], None] = lambda n: None,
) -> Recorder:
    """Pursue the targets one after the other; each starts from the final configuration of the previous one.

    Args:
        delays: delays of its links.
        machine: the driven machine.
        estimator: estimator of its velocities, if they are not measured.
        targets: configurations whose poses are the targets, (N, n_joint).
        start_ns: absolute time of the beginning.
        progress: called with the number of targets done.

    Returns:
        The recording; an emergency stop ends the run.
    """
    recorder = Recorder()
    seed = np.random.SeedSequence(parts.config.seed)
    graph = SimulatedGraph(
        parts.components(machine, estimator), delays, seed, start_ns=start_ns, taps=[recorder]
    )
    poses = compiled_forward(parts.task.arm)(targets)
    longest_ns = SAFETY_FACTOR * parts.maximum_ticks * nanoseconds(parts.task.machine.dt_s)
    for number in range(len(targets)):
        goal = ReachGoal(number, np.asarray(poses.position[number]), np.asarray(poses.quaternion[number]))
        graph.send(Topic.goal, goal)
        n_before = len(recorder.results)
        graph.run(graph.time_ns + longest_ns, lambda n=n_before: len(recorder.results) > n)  # type: ignore[misc]
        progress(number + 1)
        if recorder.stops:
            break
    return recorder
