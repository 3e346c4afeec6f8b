"""Stage `prove`: the former policy and the new one of a repair on the machine, over the same targets."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import ControllerKeys, settings_of
from pipeline.configuration.paths import InputLogs
from pipeline.configuration.stage import stage
from pipeline.control.repair.files import add_machine_trials, read_policies
from pipeline.control.repair.logged_comparison import compare_logged
from pipeline.deployment.compose import GraphSettings
from pipeline.errors import InputError
from pipeline.logs.ingest_config import IngestConfig
from pipeline.testbench.paired_trials import PairedTrials, drive_in_pairs, nothing_to_drive
from pipeline.tracking import StageRun, flatten_metrics, progress_bar


@dataclass
class ProveStage(PairedTrials, ControllerKeys):
    """Keys of `conf/prove.yaml`."""

    ingest: IngestConfig = MISSING
    repair: str = MISSING
    former: InputLogs | None = None
    new: InputLogs | None = None
    allow_empty: bool = False
    measured: str | None = None
    recorded: str = MISSING

    def __post_init__(self) -> None:
        if (self.former is None) != (self.new is None):
            raise InputError("former and new are logs of one policy each; name both folders, or none")


@stage(ProveStage)
def main(configuration: ProveStage, run: StageRun) -> None:
    """Drive the simulated machine, or read logs of the real one; say in `repair.json` what it showed."""
    folder, output = Path(configuration.repair), Path(configuration.output)
    own = configuration.machine.name, configuration.measured, configuration.recorded
    if configuration.allow_empty and (why := nothing_to_drive(folder, *own)) is not None:
        print(f"prove: nothing is driven: {why}")
        return
    policies = read_policies(folder, Path(configuration.model), configuration.machine.name)
    former, new = configuration.former, configuration.new
    if former is None or new is None:
        settings = settings_of(GraphSettings, configuration)
        with progress_bar("prove", total=2 * configuration.targets, unit="target") as bar:
            former, new = drive_in_pairs(settings, policies, configuration, output, bar.reach)
    read_by = configuration.reaching, configuration.ingest, configuration.control.loop_tracker
    shown, told = add_machine_trials(folder, compare_logged(Path(former), Path(new), *read_by))
    print(f"prove: {told}")
    run.metrics(flatten_metrics(shown))


if __name__ == "__main__":
    main()
