"""Stage `measure_floor`: what a model misses on sound logs, which the supervisor's rule `model_residual` needs."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel, InputPath, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.deployment.components.supervision.free_running_model import FreeRunningModel
from pipeline.deployment.components.supervision.model_floor import measure_floor
from pipeline.dynamics.model.store import load_metadata
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.logs.tuples import read_tuples
from pipeline.tracking import StageRun


@dataclass
class MeasureFloorStage(PipelineConfiguration):
    """Keys of `conf/measure_floor.yaml`."""

    model: InputModel = MISSING
    tuples: list[InputPath] = MISSING
    output: OutputFile = MISSING
    speed: float = MISSING
    false_stop_hours: float = MISSING


@stage(MeasureFloorStage)
def main(configuration: MeasureFloorStage, run: StageRun) -> None:
    """Run the model beside the logs; write the floor."""
    machine, model = configuration.machine, Path(configuration.model)
    run.inputs(f"{model}/parameters.msgpack", *configuration.tuples)
    follower = FreeRunningModel(*load_dynamics(model, machine), machine)
    trajectories = [each for folder in configuration.tuples for each in read_tuples(Path(folder), machine)]
    seen_in_fit = load_metadata(model).get("trajectories", [])
    hours = configuration.false_stop_hours
    floor = measure_floor(
        follower, dynamics_fingerprint(model), trajectories, seen_in_fit, configuration.speed, hours
    )
    floor.write(Path(configuration.output))
    limits = ", ".join(
        f"{name} {limit:.2f}" for name, limit in zip(machine.joint_names, floor.limit.tolist(), strict=True)
    )
    window_s = floor.window_steps * machine.dt_s
    print(f"measure_floor: {window_s:g} s of motion are judged together; limits of the evidence: {limits}")
    if floor.hours < hours:
        print(
            f"measure_floor: these logs carry {floor.hours:.2g} hours of motion between two false stops, not "
            f"{hours:g}: give longer logs, or the supervisor a lower deployment.supervisor.false_stop_hours"
        )


if __name__ == "__main__":
    main()
