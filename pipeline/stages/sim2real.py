"""Stage `sim2real`: successive targets on the simulated machine, a stand-in for the excavator, recorded as a bag."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import ControllerKeys, settings_of
from pipeline.configuration.stage import stage
from pipeline.deployment.component import NANOSECONDS
from pipeline.deployment.compose import GraphSettings, dispatch_synchronously
from pipeline.plant.machines.simulated import SIMULATED
from pipeline.testbench.plant_machine import ChangedPlant
from pipeline.testbench.successive_targets import Ending, Pursuit, bag_in, write_note, write_pursuit
from pipeline.tracking import StageRun, Stopwatch, progress_bar


@dataclass
class Sim2RealStage(ChangedPlant, ControllerKeys):
    """Keys of `conf/sim2real.yaml`."""

    ending: Ending = MISSING
    allow_empty: bool = MISSING


@stage(Sim2RealStage)
def main(configuration: Sim2RealStage, run: StageRun) -> None:
    """Pursue the first targets of the evaluation; write one bag, and how the goals ended."""
    machine, output = configuration.machine, Path(configuration.output)
    if configuration.allow_empty and machine.name not in SIMULATED:
        print(f"sim2real: {write_note(output, machine)}")
        return
    dispatch_synchronously()
    start = configuration.start()
    bag = bag_in(output, start)
    pursuit = Pursuit.ending_by(settings_of(GraphSettings, configuration), configuration.ending)
    run.inputs(*pursuit.settings.files)
    changed = configuration.parameters(machine.name)
    watch, start_ns = Stopwatch(), int(start.timestamp()) * NANOSECONDS
    with progress_bar("sim2real", total=len(pursuit.episodes.targets), unit="target") as bar:
        recorder, contacts = pursuit.run(changed, configuration.plant_seed, start_ns, bar.reach)
    outcomes = write_pursuit(output, bag, recorder, contacts, machine)
    print(f"sim2real: {watch.speed((recorder.states[-1][0] - start_ns) / NANOSECONDS)}")
    ended = ", ".join(f"{n} {outcome}" for outcome, n in outcomes.items())
    print(f"sim2real: {ended}; the tip met ground or base {contacts} times")
    run.metrics({"contacts": contacts} | {f"goals_{outcome}": n for outcome, n in outcomes.items()})
    run.artifact(output, "deployment")


if __name__ == "__main__":
    main()
