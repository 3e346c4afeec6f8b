"""Closing the loop on folders of logs: read them, take or identify the model, close the loop, write what it gives."""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.nominal_model import given_model, nominal_model
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.discrepancy.verdict.files import LoopReport, write_closed_loop, write_note
from pipeline.discrepancy.verdict.known import known_in_words
from pipeline.discrepancy.verdict.result import ClosedLoop
from pipeline.dynamics.judgement import seen_again, seen_twice
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.errors import InputError
from pipeline.logs.formats.discovery.discover import is_empty_folder
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.loop_tracker import LoopTrackerConfig
from pipeline.logs.telling import cautions
from pipeline.logs.trajectories import load_logs
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass(frozen=True)
class LoopInputs:
    """Paths of the logs and of the model.

    Attributes:
        nominal: Folder of logs of the machine that the model describes.
        measured: Folder, or folders, of logs of the machine as it is; None: what the model lacks of the nominal logs is
            sought.
        model: Folder of the model, which may have effects already; None: it is identified from the nominal logs.
        kind: What is identified then, `nfir_dqdot` for example.
        learned: File that keeps what is learned of the nominal logs alone; None: it is not kept.
        allow_empty: Whether a note takes the place of the result where no logs are measured.
    """

    nominal: str
    measured: str | Sequence[str] | None
    model: str | None
    kind: str
    learned: str | None
    allow_empty: bool = False

    @property
    def folders(self) -> list[str]:
        """Of logs, each once."""
        return [self.nominal, *self.of_measured]

    @property
    def of_measured(self) -> list[str]:
        """Folders of measured logs."""
        return [self.measured] if isinstance(self.measured, str) else list(self.measured or ())

    def named(self, which: str) -> str:
        """What an argument was given, for messages: `nominal` or `measured`."""
        return self.nominal if which == "nominal" else ", ".join(self.of_measured)


def close_loop_on_logs(
    inputs: LoopInputs,
    output: Path,
    machine: MachineSpecification,
    ingest: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    identify: IdentifyConfig,
    settings: CloseLoopConfig,
    log: Callable[[str], None] = lambda _: None,
) -> tuple[ClosedLoop, list[Trajectory]] | None:
    """Write `closed_loop.json`, `report_data.npz`, `model_before` and `model_after` into `output`.

    Args:
        inputs: Logs and model.
        output: Folder, made where absent.
        machine: Its specification.
        ingest: Section `ingest`.
        loop_tracker: Section `control.loop_tracker`.
        identify: Section `identify`.
        settings: Section `close_loop`.
        log: Called with one sentence per step.

    Returns:
        The result and the nominal trajectories; None for a note.

    Raises:
        InputError: Logs or model cannot be used, or a file cannot be written.
    """
    given, kept = (None if path is None else Path(path) for path in (inputs.model, inputs.learned))
    if inputs.measured is None and given is None:
        raise InputError(
            "measured is not named: name logs of the machine as it is, or model=PATH to judge that model"
        )
    of_measured = inputs.of_measured
    if of_measured and inputs.allow_empty and all(is_empty_folder(Path(folder)) for folder in of_measured):
        log(write_note(output, machine, given, inputs.nominal, inputs.named("measured")))
        return None
    nominal, measured = _read(inputs, machine, ingest, loop_tracker, log)
    model, effects = given_model(given, machine)
    model = model or nominal_model(inputs.kind, nominal, machine, settings, identify)
    of_both = "" if measured is None else f" and {len(measured)} measured"
    log(f"{len(nominal)} nominal{of_both} trajectories")
    try:
        result = close_loop(
            nominal, measured, machine, model, settings, identify, log, kept=kept, given=effects
        )
    except UnusableLogs as error:
        which = "nominal" if measured is None else error.which
        raise InputError(f"{which}={inputs.named(which)}: {error.why}") from None
    shown = inputs.named("nominal" if measured is None else "measured")
    report = LoopReport(machine.name, inputs.nominal, shown, result.evidence)
    write_closed_loop(output, result, nominal, report)
    known = known_in_words(result.document.get("known", []))
    log(f"verdict {result.document['verdict']}" + (f"; known before: {known}" if known else ""))
    return result, nominal


def _read(
    inputs: LoopInputs,
    machine: MachineSpecification,
    ingest: IngestConfig,
    loop_tracker: LoopTrackerConfig,
    log: Callable[[str], None],
) -> tuple[list[Trajectory], list[Trajectory] | None]:
    """Nominal and measured trajectories; None where no folder of these is named."""
    logs = [
        [one for folder in folders for one in load_logs(Path(folder), machine, ingest, loop_tracker)]
        for folders in ([inputs.nominal], inputs.of_measured)
    ]
    for caution in cautions(itertools.chain(*logs)):
        log(caution)
    nominal, measured = ([rows for one in read for rows in one.trajectories] for read in logs)
    for which, rows in (("nominal", nominal), ("measured", measured)):
        if (twice := seen_twice(rows)) is not None:
            raise InputError(
                f"{which}={inputs.named(which)}: trajectory {twice.name} is there twice, which would count as twice "
                "the evidence; name each recording once"
            )
    if (again := seen_again(nominal, measured)) is not None:
        log(
            f"caution: trajectory {again.name} of measured={inputs.named('measured')} is among "
            f"nominal={inputs.nominal}, too; in what is the same nothing can be found"
        )
    return nominal, measured if inputs.of_measured else None
