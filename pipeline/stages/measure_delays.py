"""Stage `measure_delays`: how late messages, decisions and ticks are on the real graph; what `sim2sim` draws from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.graph import GraphKeys, node_commands, settings_of
from pipeline.configuration.overrides import of_this_job, replaced
from pipeline.configuration.paths import OutputFile
from pipeline.configuration.stage import stage
from pipeline.control.icem.variant import RewardVariant
from pipeline.deployment.nodes import NodeSettings
from pipeline.testbench.measured_delays import measure_delays
from pipeline.tracking import StageRun

UNSUPERVISED = (
    "deployment.supervisor.rules=[]",
    "deployment.interface.supervised=false",
)  # as in this stage's file


@dataclass
class MeasureDelaysStage(GraphKeys):
    """Keys of `conf/measure_delays.yaml`."""

    planner: RewardVariant | None = None
    delays: OutputFile = MISSING


@stage(MeasureDelaysStage)
def main(configuration: MeasureDelaysStage, run: StageRun) -> None:
    """Run the graph over the targets, with the policy and with the planner; write delays and the real-time table."""
    given = of_this_job(configuration)

    def commands(settings: NodeSettings, output: Path) -> Mapping[str, Sequence[str]]:
        own = {"policy": settings.policy, "variant": settings.variant, "output": str(output)}
        return node_commands(configuration, [*UNSUPERVISED, *replaced(given, own)])

    settings, output = settings_of(NodeSettings, configuration), Path(configuration.output)
    print(
        measure_delays(settings, configuration.planner, commands, output, Path(configuration.delays)), end=""
    )


if __name__ == "__main__":
    main()
