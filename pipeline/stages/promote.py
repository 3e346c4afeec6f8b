"""Stage `promote`: by a person's word, the policy of a repair becomes the champion."""

from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.control.repair.files import FORMER, NEW, ON_MACHINE, read_repair
from pipeline.errors import InputError
from pipeline.tracking import StageRun


@dataclass
class PromoteStage(PipelineConfiguration):
    """Keys of `conf/promote.yaml`."""

    repair: InputModel = MISSING


@stage(PromoteStage)
def main(configuration: PromoteStage, run: StageRun) -> None:
    """Register the policy, and give it the alias `champion`."""
    folder, machine = Path(configuration.repair), configuration.machine.name
    document = read_repair(folder)
    if not document["promotable"]:
        raise InputError(
            f"{folder}: not promotable: {document['reason']}; repair it again, or keep the former"
        )
    if document["machine"] != machine:
        raise InputError(f"{folder}: of machine {document['machine']}; add machine={document['machine']}")
    if document[ON_MACHINE] is None:
        print("promote: it was never driven on the machine; see the stage prove")
    run.inputs(folder / NEW / "policy.msgpack", folder / FORMER / "policy.msgpack")
    name = f"{machine}-policy"
    version = run.promote(name, folder / NEW, folder / FORMER)
    print(f"promote: {name} version {version} is the champion; {document['reason']}")


if __name__ == "__main__":
    main()
