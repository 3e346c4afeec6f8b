"""Policies drive one machine over the same targets in short sessions, recorded as bags.

A session begins with the machine at rest and its oil at the temperature of a recording's start, as the logs that the
model was corrected by; in the field with a start of its own. It is simulated once per policy with the same chances. So
what one policy heats or wears meets no other trial but those of its own session.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path

import numpy as np

from pipeline.control.policy import Policy
from pipeline.control.repair.files import note_in
from pipeline.deployment.component import NANOSECONDS, nanoseconds
from pipeline.deployment.components.goals import known_configurations
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.compose import GraphSettings, controller_delays, dispatch_synchronously, graph_parts
from pipeline.deployment.successive import run_successive
from pipeline.errors import InputError
from pipeline.logs.formats.recorded_folders import clear_recorded, list_recorded
from pipeline.plant.machines.simulated import SIMULATED
from pipeline.plant.recording.session import SESSION_NAME
from pipeline.testbench.plant_machine import ChangedPlant, PlantMachine
from pipeline.testbench.recording import own_logs_among

PAUSE_S = 1  # between two bags, which are named by the second that they begin in


@dataclass(kw_only=True)
class PairedTrials(ChangedPlant):
    """Trials on the plant.

    Attributes:
        targets: How many each policy pursues.
        session_targets: Targets that are pursued one after the other before the machine rests.
    """

    targets: int
    session_targets: int


def drive_in_pairs(
    settings: GraphSettings,
    policies: Mapping[str, Policy],
    trials: PairedTrials,
    output: Path,
    progress: Callable[[int], None] = lambda n: None,
) -> list[str]:
    """Pursue the first targets of the evaluation with each policy, on the plant in simulated time.

    Args:
        settings: Of the graph; the policy that it names counts for its kind alone.
        policies: By the name of the folder that its bags go to.
        trials: The plant, and how many targets are pursued on it.
        output: Parent of the bags' folders, which are made anew.
        progress: Called with the number of targets done, over all policies.

    Returns:
        The bags' folders, in the policies' order.

    Raises:
        InputError: A number of targets is below 1, or above that of the evaluation; or a bag's folder holds something
            else than an earlier run's.
    """
    n_targets, n_session = trials.targets, trials.session_targets
    for name, value in {"targets": n_targets, "session_targets": n_session}.items():
        if value < 1:
            raise InputError(f"{name} is {value}; it must be at least 1")
    dispatch_synchronously()
    episodes = settings.reaching.fixed_episodes(n_targets)
    if n_targets > (known := len(episodes.targets)):
        raise InputError(f"targets is {n_targets}; the evaluation has {known} (episodes.evaluation_episodes)")
    parts = {name: graph_parts(settings, policy) for name, policy in policies.items()}
    delays = controller_delays(settings)
    firsts, start = range(0, n_targets, n_session), trials.start()
    parameters = [trials.parameters(settings.machine.name, session) for session, _ in enumerate(firsts)]
    clear_recorded(output, policies, "prove", {})
    done, bags = 0, []
    for session, first in enumerate(firsts):
        targets = episodes.targets[first : first + n_session]
        for name, own in parts.items():
            at_rest = np.asarray(episodes.starts[first], float)
            plant = PlantMachine(parameters[session], trials.plant_seed + session, at_rest)
            recorder = run_successive(
                own.with_goals(known_configurations(own.task.arm, targets)),
                delays,
                plant,
                VelocityEstimator(nanoseconds(settings.machine.dt_s), settings.loop_tracker),
                targets,
                int(start.timestamp()) * NANOSECONDS,
                lambda n, before=done: progress(before + n),  # type: ignore[misc]
            )
            bags.append(output / name / start.strftime(SESSION_NAME))
            list_recorded(output, bags)
            recorder.write(bags[-1], settings.machine)
            done += len(targets)
            took_s = (recorder.states[-1][0] / NANOSECONDS) - start.timestamp()
            start += timedelta(seconds=int(took_s) + 1 + PAUSE_S)
    return [str(output / name) for name in policies]


def nothing_to_drive(repair: Path, machine: str, measured: str | None, recorded: str) -> str | None:
    """Why the simulated machine says nothing of a repair; None where it does.

    Args:
        repair: Its folder.
        machine: Name of the machine.
        measured: Logs of the machine as it is, which the repair's model was corrected by.
        recorded: Where those of the simulated machine are.
    """
    if own_logs_among({"measured": (measured, Path(recorded))}):
        return f"the logs in {measured} are of your own machine; drive it, and name former and new"
    if machine not in SIMULATED:
        return f"there is no simulated plant of {machine}"
    return note_in(repair)
