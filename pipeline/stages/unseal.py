"""Stage `unseal`: what was switched on in the simulated machine, and whether the closed loop's verdict is right."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputLogs, InputPath, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.files.atomic import write_json
from pipeline.plant.sealed.unseal import unseal
from pipeline.tracking import StageRun


@dataclass
class UnsealStage(PipelineConfiguration):
    """Keys of `conf/unseal.yaml`."""

    closed_loop: InputPath = MISSING
    measured: InputLogs | None = None
    seal: InputPath = MISSING
    output: OutputFile = MISSING


@stage(UnsealStage)
def main(configuration: UnsealStage, run: StageRun) -> None:
    """Write `judgement.json`; of a user's own logs nobody knows the truth, which it then says."""
    output = Path(configuration.output)
    content = unseal(Path(configuration.closed_loop), Path(configuration.seal), configuration.measured)
    if "note" not in content:
        run.inputs(configuration.closed_loop, configuration.seal)
        run.metrics({key: float(value) for key, value in content.items() if isinstance(value, bool)})
    write_json(output, content)
    print(f"unseal: {content.get('note') or ('right' if content['verdict_right'] else 'not right')}")
    run.artifact(output)


if __name__ == "__main__":
    main()
