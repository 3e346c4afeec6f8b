"""Stage `measure_delays`: how late messages, decisions and ticks are on the real graph; what `sim2sim` draws from."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.atomic_files import write_whole
from pipeline.configuration import stage
from pipeline.deployment.ros1.measurements import distributions, load_measured, real_time_table
from pipeline.deployment.simulated_time.delays import save_delays
from pipeline.stages.graph_node import GraphStage
from pipeline.stages.run_graph import run_targets
from pipeline.tracking import StageRun


@dataclass
class MeasureDelaysStage(GraphStage):
    """Keys of `conf/measure_delays.yaml`."""

    delays: str = MISSING


@stage(MeasureDelaysStage)
def main(configuration: MeasureDelaysStage, run: StageRun) -> None:
    """Run the graph over the targets; write the file of delays and the real-time table."""
    output = Path(configuration.output)
    load_before = os.getloadavg()[0]
    results, _ = run_targets(configuration, sys.argv[1:])
    measured = load_measured(output / "nodes")
    how = {
        "command": "measure_delays",
        "targets": len(results),
        "outcomes": [str(result.outcome) for result in results],
        "cores": os.cpu_count(),
        "load_average_before": round(load_before, 2),
        "load_average_after": round(os.getloadavg()[0], 2),
    }
    save_delays(Path(configuration.delays), distributions(measured), how)
    table = real_time_table(measured)
    write_whole(output / "real_time.md", table.encode())
    print(table, end="")


if __name__ == "__main__":
    main()
