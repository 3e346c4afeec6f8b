"""Stage `sim2real`: successive targets on the simulated machine, a stand-in for the excavator, recorded as a bag."""

import enum
import json
import math
import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import jax
import numpy as np
from omegaconf import MISSING

from pipeline.configuration.load import MACHINE_DIRECTORY
from pipeline.configuration.stage import stage
from pipeline.deployment.component import NANOSECONDS, Component, nanoseconds
from pipeline.deployment.components.control_supervisor import ControlSupervisor
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.components.goals import known_configurations
from pipeline.deployment.components.supervisor_rules import build_rules
from pipeline.deployment.components.velocity_estimator import VelocityEstimator
from pipeline.deployment.drivers.machine import Sample
from pipeline.deployment.successive import run_successive
from pipeline.files.atomic import write_whole
from pipeline.logs.formats.recorded_folders import refuse_foreign
from pipeline.plant.machines.simulated import SIMULATED, simulated_machine
from pipeline.plant.parameters import Parameters
from pipeline.plant.recording.session import SESSION_NAME, read_moment
from pipeline.plant.sealed.undeclared import draw_effects
from pipeline.plant.simulator import Plant
from pipeline.reaching.episodes import evaluation_episodes
from pipeline.stages.sim2sim import Sim2SimStage, Stopwatch, controller_delays, controller_files, graph_parts
from pipeline.tracking import StageRun, progress_bar

GOALS = "goals.json"  # how they ended
PERIOD_S = 0.01  # at which the plant is advanced: commands act within so much of their arrival


class Ending(enum.StrEnum):
    """When a trial ends."""

    time_out = "time_out"  # as in the paper's table, unless deployment.termination says otherwise
    goal = (
        "goal"  # on reaching the tolerances of deployment.termination too, as in the paper's last experiment
    )


@dataclass
class Sim2RealStage(Sim2SimStage):
    """Keys of `conf/sim2real.yaml`."""

    ending: Ending = MISSING
    allow_empty: bool = MISSING
    start_time: str = MISSING
    plant_seed: int = MISSING
    effects: list[str] = field(default_factory=list)
    effects_seed: int = MISSING
    effect_size: float = MISSING


class PlantMachine:
    """The plant behind a driver: encoder readings at their own rate, no velocities."""

    def __init__(self, parameters: Parameters, seed: int, start: np.ndarray) -> None:
        """A plant at rest in `start`, (n_joint,), rad; it takes commands every `PERIOD_S`."""
        numerics = parameters.numerics._replace(control_period_s=PERIOD_S)
        self._plant = Plant(parameters._replace(numerics=numerics), seed, start)

    @property
    def period_ns(self) -> int:
        """Length of one period."""
        return nanoseconds(PERIOD_S)

    def read(self) -> Sequence[Sample]:
        """Nothing yet: the encoders' first readings come with the first periods."""
        return ()

    def advance(self, command: np.ndarray) -> Sequence[Sample]:
        """One period."""
        states = self._plant.step(np.asarray(command)).joint_states
        ages_ns = np.maximum(np.round((self._plant.time_s - states.stamp_s) * NANOSECONDS), 0).astype(int)
        return [Sample(int(age), q, None) for age, q in zip(ages_ns, states.position_rad, strict=True)]


def changed_machine(configuration: Sim2RealStage) -> Parameters:
    """The machine with the effects named, all of which have set in: drawn as `record_changed` draws them."""
    nominal = simulated_machine(configuration.machine.name)
    effects = draw_effects(
        configuration.effects, configuration.effects_seed, nominal, configuration.effect_size, math.inf
    )
    for effect in effects:
        nominal = effect.apply(nominal)
    return nominal


@stage(Sim2RealStage)
def main(configuration: Sim2RealStage, run: StageRun) -> None:
    """Pursue the first targets of the evaluation; write one bag, and how the goals ended."""
    if configuration.allow_empty and configuration.machine.name not in SIMULATED:
        write_note(configuration)
        return
    jax.config.update(
        "jax_cpu_enable_async_dispatch", False
    )  # calls are so short that handing them over costs more
    if configuration.ending is Ending.goal:
        until_goal = replace(configuration.deployment.termination, at_goal=True)
        configuration.deployment = replace(configuration.deployment, termination=until_goal)
    machine, deployment, output = configuration.machine, configuration.deployment, Path(configuration.output)
    start = read_moment("start_time", configuration.start_time)
    bag = output / "logs" / start.strftime(SESSION_NAME)
    refuse_others_log(bag)
    parts, conditions = graph_parts(configuration, machine), configuration.episodes
    run.inputs(*controller_files(configuration))
    plans = configuration.kind is ControllerKind.icem
    episodes = evaluation_episodes(
        machine, parts.task.arm, conditions, conditions.evaluation_seed, conditions.evaluation_episodes
    ).first(deployment.planner_targets if plans else deployment.targets)
    parts = parts.with_goals(known_configurations(parts.task.arm, episodes.targets))
    plant = PlantMachine(
        changed_machine(configuration), configuration.plant_seed, np.asarray(episodes.starts[0], float)
    )
    supervisor: tuple[Component, ...] = ()
    if deployment.supervisor.rules:
        rules = build_rules(machine, deployment.supervisor, MACHINE_DIRECTORY)
        supervisor = (ControlSupervisor(rules, deployment.supervisor.period_s),)
    watch, start_ns = Stopwatch(), int(start.timestamp()) * NANOSECONDS
    with progress_bar("sim2real", total=len(episodes.targets), unit="target") as bar:
        recorder = run_successive(
            parts,
            controller_delays(configuration),
            plant,
            VelocityEstimator(nanoseconds(machine.dt_s), configuration.control.loop_tracker),
            episodes.targets,
            start_ns,
            supervisor,
            lambda done: bar.update(done - bar.n) and None,
        )
    outcomes = Counter(str(result.outcome) for result in recorder.results)
    content = {
        "outcomes": dict(outcomes),
        "goals": [
            {"goal": result.goal_id, "outcome": result.outcome, "ticks": result.n_ticks}
            for result in recorder.results
        ],
        "stops": [{"rule": stop.rule, "detail": stop.detail} for stop in recorder.stops],
    }
    write_whole(output / GOALS, (json.dumps(content, indent=1) + "\n").encode())
    shutil.rmtree(bag, ignore_errors=True)
    recorder.write(bag, machine)
    print(f"sim2real: {watch.speed((recorder.states[-1][0] - start_ns) / NANOSECONDS)}")
    print("sim2real: " + ", ".join(f"{n} {outcome}" for outcome, n in outcomes.items()))
    run.metrics({f"goals_{outcome}": n for outcome, n in outcomes.items()})
    run.artifact(output, "deployment")


def refuse_others_log(bag: Path) -> None:
    """Raise `InputError` where the bag, which is made anew, stands for a log that is no earlier run's."""
    is_run = (bag.parents[1] / GOALS).exists()  # written before the bag
    refuse_foreign(
        [bag.parent],
        lambda entry: entry.name != bag.name or is_run,
        "sim2real",
        "move it away, or name another output or start_time",
    )


def write_note(configuration: Sim2RealStage) -> None:
    """For a machine of which there is no plant: it has to drive itself."""
    output = Path(configuration.output)
    output.mkdir(parents=True, exist_ok=True)
    note = f"there is no simulated plant of {configuration.machine.name}; drive the machine, and evaluate its logs"
    (output / GOALS).write_text(json.dumps({"note": note}, indent=1) + "\n")
    print(f"sim2real: {note}")


if __name__ == "__main__":
    main()
