"""Stage `sweep_delays`: what longer delays of the loop cost a controller on its model (Sim2Sim)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import MISSING

from pipeline.configuration.graph import ControllerKeys, settings_of
from pipeline.configuration.stage import stage
from pipeline.deployment.compose import GraphSettings, dispatch_synchronously, graph_parts
from pipeline.deployment.evaluate_in_graph import evaluate_in_graph
from pipeline.errors import InputError
from pipeline.files.atomic import write_json, write_whole
from pipeline.reporting.figures.delay_sweep import delay_sweep_figure
from pipeline.reporting.tables.delay_sweep import delay_sweep_table
from pipeline.tracking import StageRun, progress_bar


@dataclass
class SweepDelaysStage(ControllerKeys):
    """Keys of `conf/sweep_delays.yaml`."""

    extra_delays_s: list[float] = MISSING
    n_episodes: int = MISSING


@stage(SweepDelaysStage)
def main(configuration: SweepDelaysStage, run: StageRun) -> None:
    """Run the first of the fixed episodes once per delay; write metrics, table and figure."""
    delays_s, output = configuration.extra_delays_s, Path(configuration.output)
    if not delays_s or any(not delay_s >= 0 for delay_s in delays_s):
        raise InputError(f"extra_delays_s is {delays_s}; list delays in s, none of them negative")
    dispatch_synchronously()
    settings = settings_of(GraphSettings, configuration)
    parts = graph_parts(settings)
    run.inputs(*settings.files)
    episodes = settings.reaching.fixed_episodes(configuration.n_episodes)
    swept: dict[float, dict[str, Any]] = {}
    for delay_s in delays_s:
        with progress_bar(f"+{1000 * delay_s:.0f} ms", total=len(episodes.starts), unit="episode") as bar:
            _, swept[delay_s] = evaluate_in_graph(settings, parts, episodes, bar.reach, delay_s)
    output.mkdir(parents=True, exist_ok=True)
    write_json(output / "metrics.json", {f"{delay_s:g}": metrics for delay_s, metrics in swept.items()})
    write_whole(output / "delay_sweep.svg", delay_sweep_figure(swept))
    table = delay_sweep_table(swept)
    table.write(output, "delay_sweep")
    print(table.markdown())
    run.artifact(output, "delay_sweep")


if __name__ == "__main__":
    main()
