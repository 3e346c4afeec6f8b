"""Stage `teleoperate`: somebody at a joystick drives the machine through the graph, and it is recorded as a bag."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import GraphKeys, commanded_by, settings_of
from pipeline.configuration.own_process import for_this_job
from pipeline.configuration.stage import stage
from pipeline.deployment.nodes import Driver
from pipeline.errors import InputError
from pipeline.testbench.graph_node import component
from pipeline.testbench.teleoperation import GraphKind, Sticks, TeleoperationSettings, record_teleoperation
from pipeline.tracking import StageRun


@dataclass
class TeleoperateStage(GraphKeys):
    """Keys of `conf/teleoperate.yaml`."""

    graph: GraphKind = MISSING
    joystick: Sticks = MISSING
    seconds: float = MISSING

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.seconds > 0:
            raise InputError(f"seconds={self.seconds}: it must be positive")
        self.check_model()
        of_real_time = self.driver is Driver.can or self.joystick is Sticks.device
        if self.graph is GraphKind.simulated_time and of_real_time:
            raise InputError(
                "graph=simulated_time: takes neither driver=can nor joystick=device, which keep real time"
            )


@stage(TeleoperateStage)
def main(configuration: TeleoperateStage, run: StageRun) -> None:
    """Run the graph for so many seconds; write what it heard as one more bag in the folder `logs` of the output."""
    output, settings = Path(configuration.output), settings_of(TeleoperationSettings, configuration)
    for name in settings.commanding:
        component(settings, name)  # a mistake in their settings is told here, not in a node's log
    if settings.graph is GraphKind.simulated_time:
        counts = record_teleoperation(settings, {}, output)
    else:
        commands = commanded_by(configuration, settings.commanding)
        counts = for_this_job(record_teleoperation, settings, commands, output)
    run.metrics(counts)


if __name__ == "__main__":
    main()
