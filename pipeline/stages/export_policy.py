"""Stage `export_policy`: a policy becomes a C file for a programmable controller, or ONNX."""

import enum
from dataclasses import dataclass
from pathlib import Path

from omegaconf import MISSING

from pipeline.configuration.paths import InputModel
from pipeline.configuration.reaching import ReachingKeys
from pipeline.configuration.stage import stage
from pipeline.control.policy import POLICY_FILE
from pipeline.deployment.export.c_file import policy_as_c
from pipeline.deployment.export.exported import exported_policy
from pipeline.deployment.export.onnx_file import policy_as_onnx
from pipeline.files.atomic import write_whole
from pipeline.tracking import StageRun


class PolicyFormat(enum.StrEnum):
    """What a policy is written as; also the ending of the file's name."""

    c = "c"
    onnx = "onnx"


@dataclass
class ExportPolicyStage(ReachingKeys):
    """Keys of `conf/export_policy.yaml`."""

    policy: InputModel = MISSING
    format: PolicyFormat = MISSING


@stage(ExportPolicyStage)
def main(configuration: ExportPolicyStage, run: StageRun) -> None:
    """Write `policy.c` or `policy.onnx`."""
    model, policy = Path(configuration.model), Path(configuration.policy)
    run.inputs(f"{model}/parameters.msgpack", f"{policy}/{POLICY_FILE}")
    exported = exported_policy(model, policy, configuration.reaching, configuration.control.loop_tracker)
    content = (
        policy_as_c(exported).encode() if configuration.format is PolicyFormat.c else policy_as_onnx(exported)
    )
    file = Path(configuration.output) / f"policy.{configuration.format}"
    write_whole(file, content)
    print(f"export_policy: {file}: {len(content)} bytes")
    run.artifact(file.parent, "exported_policy")


if __name__ == "__main__":
    main()
