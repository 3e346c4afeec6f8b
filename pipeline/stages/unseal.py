"""Stage `unseal`: what was switched on in the simulated machine, and whether the closed loop's verdict is right."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from omegaconf import MISSING

from pipeline.configuration.paths import InputLogs, InputPath, OutputFile
from pipeline.configuration.stage import PipelineConfiguration, stage
from pipeline.errors import InputError
from pipeline.files.atomic import write_whole
from pipeline.plant.sealed.seal import open_seal
from pipeline.plant.sealed.verdict_judgement import judge_verdict
from pipeline.tracking import StageRun

SESSIONS = "sessions"  # beside the seal: the bags that it is about


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
    document, seal = read_document(Path(configuration.closed_loop)), Path(configuration.seal)
    measured = configuration.measured
    content: dict[str, Any]
    if measured is not None and Path(measured).resolve() != (seal.parent / SESSIONS).resolve():
        content = {"note": f"the logs in {measured} are your own: there is no seal to open"}
    elif "verdict" not in document:
        content = {"note": "the loop was not closed: there is nothing to judge"}
    else:
        run.inputs(configuration.closed_loop, seal)
        truth = open_seal(seal)
        try:
            content = asdict(judge_verdict(truth, document))
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(
                f"{configuration.closed_loop}: is not what close_loop writes ({type(error).__name__}: {error}); run it "
                "again"
            ) from error
        run.metrics({key: float(value) for key, value in content.items() if isinstance(value, bool)})
    write_whole(Path(configuration.output), (json.dumps(content, indent=1) + "\n").encode())
    print(f"unseal: {content.get('note') or ('right' if content['verdict_right'] else 'not right')}")
    run.artifact(Path(configuration.output))


def read_document(path: Path) -> dict[str, Any]:
    """Read `closed_loop.json`.

    Raises:
        InputError: It is missing or no such document.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; run close_loop first") from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON ({error}); run close_loop again") from error
    if not isinstance(document, dict) or not {"verdict", "note"} & set(document):
        raise InputError(f"{path}: is not what close_loop writes; run it again")
    return document


if __name__ == "__main__":
    main()
