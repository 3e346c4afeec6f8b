"""A log as read from any format: joint samples and commands with their stamps."""

import enum
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.logs.messages.columns import Column

NANOSECONDS = 1_000_000_000  # per second


class NoteKind(enum.StrEnum):
    """Kind of a note about a log."""

    damage = "damage"  # bytes that could not be read
    left_out = "left_out"  # messages or samples that were read but not used
    changed = "changed"  # values that differ from those in the log
    attention = "attention"  # no action was taken, but the user should know
    warning = "warning"  # rows are probably wrong until the user acts


@dataclass(frozen=True)
class Note:
    """One line of the quality report: what was lost, left out or changed, where and how often.

    Attributes:
        kind: Whether the note is about damage, a loss or a change.
        text: One line.
        count: Number of messages, samples or places concerned.
        is_usual: Whether sound logs have it, too; it is then told in the quality report only.
    """

    kind: NoteKind
    text: str
    count: int = 1
    is_usual: bool = False


def first_damage(notes: Iterable[Note]) -> str:
    """What is added to a refusal: the first note of damage; empty without one."""
    return next((f"; damage: {note.text}" for note in notes if note.kind is NoteKind.damage), "")


def first_loss(notes: Iterable[Note]) -> str:
    """What is added to a refusal: the first note of damage, or else of a warning or a loss; empty without one."""
    told = [note for note in notes if not note.is_usual]
    likely = [
        note.text for kind in (NoteKind.warning, NoteKind.left_out) for note in told if note.kind is kind
    ]
    return first_damage(told) or next((f"; {text}" for text in likely), "")


@dataclass(frozen=True)
class TargetPoses:
    """Target poses of the end effector in frame {B}.

    Attributes:
        log_time_ns: Log time of each target, shape (K,), int64.
        position: m, shape (K, 3), float64.
        quaternion: Unit quaternion (w, x, y, z), shape (K, 4), float64.
        frame_id: The messages' frame.
    """

    log_time_ns: Column
    position: Column
    quaternion: Column
    frame_id: str


@dataclass(frozen=True)
class ChannelSamples:
    """What a log holds of one channel.

    Attributes:
        time_ns: Shape (K,), int64, by the clock that the machine's configuration names.
        value: Shape (K,), float64, in the channel's unit.
    """

    time_ns: Column
    value: Column


@dataclass(frozen=True)
class RawLog:
    """One log as recorded: every message in file order, nothing resampled or cleaned.

    Its columns are arrays, or files that are read by slices.

    Attributes:
        name: The bag's name, without folder and suffix.
        path: Where it was read.
        joint_stamp_ns: `header.stamp` of each joint sample, shape (N,), int64; zero if the log lacks it.
        joint_log_time_ns: Log time of each joint sample, shape (N,), int64.
        q: Joint positions in the machine's joint order, shape (N, n_joint), float64, rad or m.
        command_log_time_ns: Log time of each command, shape (M,), int64.
        command_stamp_ns: `header.stamp` of each command, shape (M,), int64; None where log time times the commands.
        command: Commands in the machine's joint order, shape (M, n_joint), float64.
        targets: Target poses, if the log has any.
        message_counts: Messages per topic (rows per file for tables), all topics of the log.
        notes: Damage, losses and irregularities.
        channels: By name, those of the machine's channels that the log has.
    """

    name: str
    path: Path
    joint_stamp_ns: Column
    joint_log_time_ns: Column
    q: Column
    command_log_time_ns: Column
    command: Column
    targets: TargetPoses | None = None
    command_stamp_ns: Column | None = None
    message_counts: dict[str, int] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    channels: dict[str, ChannelSamples] = field(default_factory=dict)
