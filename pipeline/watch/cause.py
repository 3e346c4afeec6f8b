"""Why a machine changed: the loop is closed on what was recorded since."""

import itertools
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from pipeline.discrepancy.close_loop import close_loop
from pipeline.discrepancy.nominal_model import given_model
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.discrepancy.verdict.files import DOCUMENT, LoopReport, write_closed_loop
from pipeline.errors import InputError
from pipeline.files.atomic import write_json
from pipeline.logs.formats.discovery.discover import find_logs
from pipeline.logs.tuples import Trajectory
from pipeline.watch.session_store import SessionRecord
from pipeline.watch.watch_inputs import WatchInputs, WatchSettings, read_session

USED = "sessions.json"  # beside the loop's files: on which sessions it was closed
LEARNED = "nominal_learned.npz"  # of the state: the second cause takes half as long


def cause_of(
    since: Sequence[SessionRecord],
    inputs: WatchInputs,
    settings: WatchSettings,
    log: Callable[[str], None],
) -> dict[str, Any]:
    """Close the loop on the latest sessions since a change, unless it was closed on half as many already.

    Args:
        since: Sessions since the change, in order.
        inputs: Paths; the loop's files go to a folder of `output`, named after the first session.
        settings: How.
        log: Called with one sentence per step.

    Returns:
        The folder, how many sessions were used, and `closed_loop.json`; or why there is none.

    Raises:
        InputError: Nominal logs or the model cannot be used, or a file cannot be written.
    """
    folder = inputs.output / f"change_{since[0].content[:12]}"
    if (done := _done(folder)) is None or 2 * done < len(since):
        measured = _latest(since, settings)
        if not measured:
            return {"note": "the sessions since the change cannot be read any more; their logs are gone"}
        try:
            _close(folder, measured, inputs, settings, log)
        except UnusableLogs as error:
            return {"note": error.why}
        done = len(since)
        write_json(folder / USED, {"sessions": done})
    document = json.loads((folder / DOCUMENT).read_text())
    return {"folder": folder.name, "sessions": done, "closed_loop": document}


def _done(folder: Path) -> int | None:
    try:
        return int(json.loads((folder / USED).read_text())["sessions"])
    except (OSError, ValueError, KeyError, TypeError):  # written last: the loop was not closed
        return None


def _latest(since: Sequence[SessionRecord], settings: WatchSettings) -> list[Trajectory]:
    """Trajectories of the latest sessions that may be read, in order, of `cause_minutes` together."""
    left_s = 60.0 * settings.watch.cause_minutes
    taken: list[list[Trajectory]] = []
    for record in reversed(since):
        if taken and left_s <= 0.0:
            break
        try:
            (entry,) = find_logs(Path(record.path))
            taken.append(read_session(entry, settings).trajectories)
        except (InputError, ValueError):  # moved since: the others serve
            continue
        left_s -= sum(map(len, taken[-1])) * settings.machine.dt_s
    return list(itertools.chain(*reversed(taken)))


def _close(
    folder: Path,
    measured: list[Trajectory],
    inputs: WatchInputs,
    settings: WatchSettings,
    log: Callable[[str], None],
) -> None:
    nominal = [
        trajectory
        for entry in find_logs(inputs.nominal)
        for trajectory in read_session(entry, settings).trajectories
    ]
    machine = settings.machine
    model, effects = given_model(inputs.model, machine)
    result = close_loop(
        nominal,
        measured,
        machine,
        model,
        settings.close_loop,
        settings.identify,
        log,
        kept=inputs.state / LEARNED,
        given=effects,
    )
    report = LoopReport(machine.name, str(inputs.nominal), str(inputs.sessions), result.evidence)
    write_closed_loop(folder, result, nominal, report)
