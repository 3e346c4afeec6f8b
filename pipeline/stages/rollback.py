"""Stage `rollback`: the policy that was champion before the present one is so again."""

from dataclasses import dataclass

from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.tracking import StageRun


@dataclass
class RollbackStage(PipelineConfiguration):
    """Keys of `conf/rollback.yaml`."""


@stage(RollbackStage)
def main(configuration: RollbackStage, run: StageRun) -> None:
    """Move the alias `champion` back."""
    name = f"{configuration.machine.name}-policy"
    present, former = run.roll_back(name)
    print(f"rollback: {name} version {former} is the champion again, in place of version {present}")


if __name__ == "__main__":
    main()
