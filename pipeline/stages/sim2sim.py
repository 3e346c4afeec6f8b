"""Stage `sim2sim`: a controller drives its model through the asynchronous graph, in simulated time."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.configuration.graph import ControllerKeys, settings_of
from pipeline.configuration.stage import stage
from pipeline.deployment.components.controllers import ControllerKind
from pipeline.deployment.compose import GraphSettings, dispatch_synchronously, graph_parts
from pipeline.deployment.evaluate_in_graph import evaluate_in_graph
from pipeline.reaching.evaluation_files import write_evaluation
from pipeline.tracking import StageRun, Stopwatch, progress_bar


@dataclass
class Sim2SimStage(ControllerKeys):
    """Keys of `conf/sim2sim.yaml`."""


@stage(Sim2SimStage)
def main(configuration: Sim2SimStage, run: StageRun) -> None:
    """Run the fixed episodes; write metrics, success-rate matrix, episodes and traces."""
    dispatch_synchronously()
    settings, output = settings_of(GraphSettings, configuration), Path(configuration.output)
    parts = graph_parts(settings)
    run.inputs(*settings.files)
    plans = settings.kind is ControllerKind.icem
    episodes = settings.reaching.fixed_episodes(settings.deployment.planner_episodes if plans else None)
    n_episodes, watch = len(episodes.starts), Stopwatch()
    with progress_bar("sim2sim", total=n_episodes, unit="episode") as bar:
        traces, metrics = evaluate_in_graph(settings, parts, episodes, bar.reach)
    print(f"sim2sim: {watch.speed(n_episodes * settings.episodes.steps * settings.machine.dt_s)}")
    write_evaluation(output, metrics, traces, episodes)
    run.metrics(metrics)
    run.artifact(output, "evaluation")


if __name__ == "__main__":
    main()
