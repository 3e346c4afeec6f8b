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
    within_s: float = MISSING


@stage(MeasureFloorStage)
def main(configuration: MeasureFloorStage, run: StageRun) -> None:
    """Run the model beside the logs; write the floor."""
    machine, model = configuration.machine, Path(configuration.model)
    run.inputs(f"{model}/parameters.msgpack", *configuration.tuples)
    follower = FreeRunningModel(*load_dynamics(model, machine), machine)
    trajectories = [each for folder in configuration.tuples for each in read_tuples(Path(folder), machine)]
    seen_in_fit = load_metadata(model).get("trajectories", [])
    speed, within_s = configuration.speed, configuration.within_s
    floor = measure_floor(follower, dynamics_fingerprint(model), trajectories, seen_in_fit, speed, within_s)
    floor.write(Path(configuration.output))
    sizes = ", ".join(
        f"{name} {size:.4f} {unit}"
        for name, size, unit in zip(machine.joint_names, floor.scale.tolist(), machine.units, strict=True)
    )
    alike = ", ".join(f"{factor:.1f}" for factor in floor.dependence.tolist())
    print(f"measure_floor: {len(floor.scores)} blocks; error per block: {sizes}; dependence {alike}")


if __name__ == "__main__":
    main()
