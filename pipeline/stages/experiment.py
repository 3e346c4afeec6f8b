"""Stage `experiment`: plays a planned experiment on the machine through the supervisor, and records it as a bag."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import GraphKeys, commanded_by, settings_of
from pipeline.configuration.own_process import for_this_job
from pipeline.configuration.stage import stage
from pipeline.discrepancy.experiment.plan import Plan, read_plan
from pipeline.errors import InputError
from pipeline.testbench.teleoperation import GraphKind, Sticks, TeleoperationSettings, record_teleoperation
from pipeline.tracking import StageRun


@dataclass
class ExperimentStage(GraphKeys):
    """Keys of `conf/experiment.yaml`."""

    graph: GraphKind = MISSING
    joystick: Sticks = MISSING
    seconds: float | None = None


@stage(ExperimentStage)
def main(configuration: ExperimentStage, run: StageRun) -> None:
    """Play the plan; write one more bag in the folder `logs` of the output. A stop ends it early."""
    output = Path(configuration.output)
    configuration.seconds = _plan(configuration).longest_s
    settings = settings_of(TeleoperationSettings, configuration)
    if settings.graph is GraphKind.simulated_time:
        counts = record_teleoperation(settings, {}, output)
    else:
        commands = commanded_by(configuration, settings.commanding)
        counts = for_this_job(record_teleoperation, settings, commands, output)
    run.metrics(counts)


def _plan(configuration: ExperimentStage) -> Plan:
    if configuration.plan is None:
        raise InputError("`plan` is missing; name the experiment.json that close_loop wrote")
    configuration.check_model()
    return read_plan(Path(configuration.plan), configuration.machine)


if __name__ == "__main__":
    main()
