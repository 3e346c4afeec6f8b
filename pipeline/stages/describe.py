"""Stage `describe`: what foreign logs hold, and a draft of the machine's file that reads them."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputLogs, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.logs.describe.describe import describe
from pipeline.logs.describe.draft import draft_machine, order_of_joints
from pipeline.logs.describe.listing import listing
from pipeline.machine.specification import MACHINE_DIRECTORY
from pipeline.tracking import StageRun


@dataclass
class DescribeStage(PipelineConfiguration):
    """Keys of `conf/describe.yaml`."""

    logs: InputLogs = MISSING
    output: OutputFile | None = None


@stage(DescribeStage)
def main(configuration: DescribeStage, run: StageRun) -> None:
    """Print what the logs hold, and write or print the draft."""
    output = Path(configuration.output) if configuration.output else None
    if output is not None and output.exists():
        raise InputError(f"{output}: is there already; name another output, or remove it")
    contents = describe(Path(configuration.logs))
    for line in listing(contents):
        print(line.encode(errors="backslashreplace").decode())
    draft = draft_machine(contents, output.stem if output else "")
    if output is None:
        print(f"\n{draft}", end="")
    else:
        write_whole(output, draft.encode(errors="backslashreplace"))
        is_there = output.resolve().parent == MACHINE_DIRECTORY
        move = "" if is_there else f"move it to {MACHINE_DIRECTORY / output.name}, "
        print(f"\ndescribe: {output}: {order_of_joints(contents)}")
        print(f"describe: replace every ???, check the guesses, {move}then ingest with machine={output.stem}")
        run.artifact(output)


if __name__ == "__main__":
    main()
