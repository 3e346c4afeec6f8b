"""Successive targets on the plant, a stand-in for the excavator, recorded as a bag (Sim2Real)."""

import enum
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from pipeline.deployment.component import nanoseconds
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.components.goals import known_configurations
from pipeline.deployment.components.recording import Recorder
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.compose import GraphSettings, controller_delays, graph_parts
from pipeline.deployment.successive import run_successive
from pipeline.deployment.trials import GraphParts
from pipeline.files.atomic import write_json
from pipeline.logs.formats.recorded_folders import refuse_foreign
from pipeline.machine.specification import MachineSpecification
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.session import SESSION_NAME
from pipeline.reaching.episodes import Episodes
from pipeline.testbench.plant_machine import PlantMachine

GOALS = "goals.json"  # how they ended


class Ending(enum.StrEnum):
    """When a trial ends."""

    time_out = "time_out"  # as in the paper's table, unless deployment.termination says otherwise
    goal = (
        "goal"  # on reaching the tolerances of deployment.termination too, as in the paper's last experiment
    )


@dataclass(frozen=True)
class Pursuit:
    """What is pursued, and with which graph.

    Attributes:
        settings: What the parts are composed of.
        parts: The graph.
        episodes: Whose targets are pursued: the first of the evaluation, as many as the controller is given.
    """

    settings: GraphSettings
    parts: GraphParts
    episodes: Episodes

    @classmethod
    def ending_by(cls, settings: GraphSettings, ending: Ending) -> "Pursuit":
        """Trials that end so."""
        deployment = settings.deployment
        if ending is Ending.goal:
            until_goal = replace(deployment.termination, at_goal=True)
            settings = replace(settings, deployment=replace(deployment, termination=until_goal))
        plans = settings.kind is ControllerKind.icem
        n_targets = deployment.planner_targets if plans else deployment.targets
        return cls(settings, graph_parts(settings), settings.reaching.fixed_episodes(n_targets))

    def run(
        self, parameters: Parameters, plant_seed: int, start_ns: int, progress: Callable[[int], None]
    ) -> tuple[Recorder, int]:
        """Pursue the targets on the plant, one after the other from the first episode's start.

        Args:
            parameters: Of the plant.
            plant_seed: Of its process variation and its encoders' noise.
            start_ns: Absolute time of the beginning.
            progress: Called with the number of targets done.

        Returns:
            The recording, and how often the tip met the ground or the machine's base.
        """
        settings, targets = self.settings, self.episodes.targets
        plant = PlantMachine(parameters, plant_seed, np.asarray(self.episodes.starts[0], float))
        recorder = run_successive(
            self.parts.with_goals(known_configurations(self.parts.task.arm, targets)),
            controller_delays(settings),
            plant,
            VelocityEstimator(nanoseconds(settings.machine.dt_s), settings.loop_tracker),
            targets,
            start_ns,
            progress,
        )
        return recorder, plant.contacts


def write_pursuit(
    output: Path, bag: Path, recorder: Recorder, contacts: int, machine: MachineSpecification
) -> Counter[str]:
    """Write how the goals ended and how often the tip met something; the bag in place of an earlier run's.

    Returns:
        How many goals ended how.
    """
    outcomes = Counter(str(result.outcome) for result in recorder.results)
    content = {
        "outcomes": dict(outcomes),
        "contacts": contacts,
        "goals": [
            {"goal": result.goal_id, "outcome": result.outcome, "ticks": result.n_ticks}
            for result in recorder.results
        ],
        "stops": [{"rule": stop.rule, "detail": stop.detail} for stop in recorder.stops],
    }
    _write_goals(output, content)
    shutil.rmtree(bag, ignore_errors=True)
    recorder.write(bag, machine)
    return outcomes


def write_note(output: Path, machine: MachineSpecification) -> str:
    """For a machine of which there is no plant: it has to drive itself."""
    note = f"there is no simulated plant of {machine.name}; drive the machine, and evaluate its logs"
    _write_goals(output, {"note": note})
    return note


def _write_goals(output: Path, content: object) -> None:
    write_json(output / GOALS, content)


def bag_in(output: Path, start: datetime) -> Path:
    """The bag of a pursuit that begins so; see `refuse_others_log`."""
    bag = output / "logs" / start.strftime(SESSION_NAME)
    refuse_others_log(bag)
    return bag


def refuse_others_log(bag: Path) -> None:
    """Raise `InputError` where the bag, which is made anew, stands for a log that is no earlier run's."""
    is_run = (bag.parents[1] / GOALS).exists()  # written before the bag
    refuse_foreign(
        [bag.parent],
        lambda entry: entry.name != bag.name or is_run,
        "sim2real",
        "move it away, or name another output or start_time",
    )
