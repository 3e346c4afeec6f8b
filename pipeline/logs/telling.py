"""What the terminal says of a log's notes: what was lost and where, and what makes rows probably wrong."""

from collections.abc import Iterable

from pipeline.logs.messages.notes import MORE, without_numbers
from pipeline.logs.messages.raw_log import Note, NoteKind
from pipeline.logs.trajectories import LogTrajectories

TOLD = (NoteKind.damage, NoteKind.left_out, NoteKind.changed)  # in this order
TOLD_NOTES, TOLD_CHARACTERS = 2, 160


def losses(notes: Iterable[Note]) -> list[str]:
    """Return at most three short texts: what was lost and where, damage first; none for a sound log."""
    told = [note for note in notes if note.kind in TOLD and not note.is_usual]
    alike: dict[str, list[Note]] = {}
    for note in sorted(told, key=lambda note: TOLD.index(note.kind)):
        alike.setdefault(without_numbers(note.text.removesuffix(MORE)), []).append(note)
    texts = [_short(*notes) for notes in alike.values()]
    more = [f"{len(texts) - TOLD_NOTES} more in the quality report"] if len(texts) > TOLD_NOTES else []
    return [*texts[:TOLD_NOTES], *more]


def warnings(notes: Iterable[Note]) -> list[str]:
    """Return what makes the rows probably wrong until the user acts."""
    return [note.text for note in notes if note.kind is NoteKind.warning]


def cautions(logs: Iterable[LogTrajectories]) -> list[str]:
    """Return a line for each log that is not sound and each warning, for commands that read logs directly."""
    lines = []
    for log in logs:
        lost = "; ".join(losses(log.notes))
        lines += [f"caution: {log.name}: {text}" for text in (lost, *warnings(log.notes)) if text]
    return lines


def _short(first: Note, *others: Note) -> str:
    text = first.text
    if first.count > 1 and str(first.count) not in text:
        is_place = first.kind is NoteKind.damage  # such a text begins with file and byte
        text = f"{text} ({first.count} times)" if is_place else f"{first.count} {text}"
    short = text if len(text) <= TOLD_CHARACTERS else f"{text[: TOLD_CHARACTERS - 1]}…"
    n_more = "more" if any(other.text.endswith(MORE) for other in others) else len(others)
    return f"{short} (and {n_more} like it)" if others else short
