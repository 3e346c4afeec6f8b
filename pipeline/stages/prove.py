"""Stage `prove`: the former policy and the new one of a repair on the machine, over the same targets."""

from dataclasses import dataclass, field
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import ControllerKeys, settings_of
from pipeline.configuration.paths import InputLogs
from pipeline.configuration.stage import stage
from pipeline.control.repair.files import FORMER, NEW, ON_MACHINE, add_machine_trials, note_in, read_policies
from pipeline.control.repair.logged_comparison import compare_logged
from pipeline.deployment.compose import GraphSettings, dispatch_synchronously
from pipeline.errors import InputError
from pipeline.logs.ingest_config import IngestConfig
from pipeline.plant.machines.simulated import SIMULATED
from pipeline.plant.recording.session import read_moment
from pipeline.testbench.alternating_trials import drive_in_turns
from pipeline.testbench.plant_machine import changed_machine
from pipeline.testbench.recording import own_logs_among
from pipeline.tracking import StageRun, flatten_metrics, progress_bar


@dataclass
class ProveStage(ControllerKeys):
    """Keys of `conf/prove.yaml`."""

    ingest: IngestConfig = MISSING
    repair: str = MISSING
    former: InputLogs | None = None
    new: InputLogs | None = None
    targets: int = MISSING
    block: int = MISSING
    start_time: str = MISSING
    plant_seed: int = MISSING
    effects: list[str] = field(default_factory=list)
    effects_seed: int = MISSING
    effect_size: float = MISSING
    allow_empty: bool = False
    measured: str | None = None
    recorded: str = MISSING

    def __post_init__(self) -> None:
        if (self.former is None) != (self.new is None):
            raise InputError("former and new are logs of one policy each; name both folders, or none")
        for name in ("targets", "block"):
            if isinstance(getattr(self, name), int) and getattr(self, name) < 1:
                raise InputError(f"{name} is {getattr(self, name)}; it must be at least 1")


@stage(ProveStage)
def main(configuration: ProveStage, run: StageRun) -> None:
    """Drive the simulated machine, or read logs of the real one; say in `repair.json` what it showed."""
    folder, output = Path(configuration.repair), Path(configuration.output)
    if configuration.allow_empty and (why := _nothing_to_drive(configuration)) is not None:
        print(f"prove: nothing is driven: {why}")
        return
    policies, former, new = read_policies(folder), configuration.former, configuration.new
    if former is None or new is None:
        dispatch_synchronously()
        names = ("plant_seed", "targets", "block")
        seed, n, block = (getattr(configuration, name) for name in names)
        draw = configuration.effects, configuration.effects_seed, configuration.effect_size
        plant = changed_machine(configuration.machine.name, *draw)
        start = read_moment("start_time", configuration.start_time)
        with progress_bar("prove", total=2 * n, unit="target") as bar:
            settings = settings_of(GraphSettings, configuration)
            drive_in_turns(settings, policies, plant, seed, n, block, start, output, bar.reach)
        former, new = str(output / FORMER), str(output / NEW)
    reaching, tracker = configuration.reaching, configuration.control.loop_tracker
    compared = compare_logged(Path(former), Path(new), reaching, configuration.ingest, tracker)
    document = add_machine_trials(folder, compared)
    shown = (f"{100 * document[ON_MACHINE][name]:.1f} %" for name in ("sr_before", "sr_after"))
    print(f"prove: success {' to '.join(shown)} over {compared.n_targets} targets; {document['reason']}")
    run.metrics(flatten_metrics(document[ON_MACHINE]))


def _nothing_to_drive(configuration: ProveStage) -> str | None:
    """Why the simulated machine says nothing of the repair; None where it does."""
    measured = configuration.measured
    if own_logs_among({"measured": (measured, Path(configuration.recorded))}):
        return f"the logs in {measured} are of your own machine; drive it, and name former and new"
    if configuration.machine.name not in SIMULATED:
        return f"there is no simulated plant of {configuration.machine.name}"
    return note_in(Path(configuration.repair))


if __name__ == "__main__":
    main()
