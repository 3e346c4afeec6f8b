"""Turn the message blocks of one topic into columns of numbers."""

from collections import Counter
from typing import Protocol

import numpy as np

from pipeline.errors import InputError, counted
from pipeline.logs.messages.columns import Column, ColumnStore
from pipeline.logs.messages.decoding.definitions import DefinitionError
from pipeline.logs.messages.decoding.encodings import decode
from pipeline.logs.messages.decoding.field_paths import NO_TIME, SELF_DESCRIBING
from pipeline.logs.messages.decoding.layout import FieldGroup, LayoutError, TooManyFieldsError
from pipeline.logs.messages.decoding.trees import UNPARSED
from pipeline.logs.messages.message_blocks import LoggedTopic, MessageBlock, ReadingLedger
from pipeline.logs.messages.mismatch import MismatchError
from pipeline.logs.messages.raw_log import Note, NoteKind, first_damage

MAXIMUM_DEFINITIONS = 1000  # of one topic that are parsed, in a second; recorders write one per publisher


class Adapter(Protocol):
    """Selects the wanted fields of a topic's messages and converts them."""

    role: str  # role of the topic in the pipeline, for messages to the user

    def wanted(self, topic: LoggedTopic) -> tuple[str, ...]:
        """Return the paths of the wanted fields.

        Raises:
            MismatchError: The topic's type lacks them.
        """
        ...

    def convert(self, group: FieldGroup) -> dict[str, np.ndarray]:
        """Return columns, each of shape (n, …), from the decoded fields of n messages.

        Raises:
            MismatchError: The messages lack wanted content.
        """
        ...


class TopicColumns:
    """Collects one topic's columns block by block, in file order.

    Unusable messages are counted by reason; if all are unusable, `finish` refuses the log.
    """

    def __init__(self, topic_name: str, adapter: Adapter, store: ColumnStore) -> None:
        self.topic_name = topic_name
        self.adapter = adapter
        self.store = store
        self.reasons: Counter[str] = Counter()
        self.definitions: set[LoggedTopic] = set()
        self.too_large: dict[LoggedTopic, TooManyFieldsError] = {}
        self.is_empty = True

    @property
    def table(self) -> str:
        """Name of the topic's columns in the store."""
        return self.adapter.role.replace(" ", "_")

    def add(self, block: MessageBlock) -> None:
        """Decode a block and append its columns."""
        self.definitions.add(block.topic)
        try:
            if len(self.definitions) > MAXIMUM_DEFINITIONS:
                raise MismatchError(f"the topic has more than {MAXIMUM_DEFINITIONS} definitions")
            if block.topic in self.too_large:
                raise self.too_large[block.topic]
            wanted = self.adapter.wanted(block.topic)
            groups, malformed = decode(block, wanted)
        except (MismatchError, DefinitionError) as reason:
            if isinstance(reason, TooManyFieldsError):
                self.too_large[block.topic] = reason
            self.reasons[str(reason)] += len(block.start)
            return
        if len(malformed):
            is_tree = block.topic.encoding in SELF_DESCRIBING
            self.reasons[UNPARSED if is_tree else "they do not fit their definition"] += len(malformed)
        parts, order = [], []
        for group in groups:
            try:
                columns = self.adapter.convert(group)
            except (MismatchError, LayoutError) as reason:
                self.reasons[str(reason)] += len(group.index)
                continue
            index = group.index
            if "stamp_ns" in columns and not (is_time := columns["stamp_ns"] != NO_TIME).all():
                self.reasons["their time stamp is not a time"] += int((~is_time).sum())
                index, columns = index[is_time], {name: rows[is_time] for name, rows in columns.items()}
            if len(index):
                parts.append({"log_time_ns": block.log_time_ns[index], **columns})
                order.append(index)
        if parts:
            columns = parts[0]
            if len(parts) > 1:
                in_file_order = np.argsort(np.concatenate(order), kind="stable")
                columns = {
                    name: np.concatenate([part[name] for part in parts])[in_file_order] for name in parts[0]
                }
            self.store.append(self.table, columns)
            self.is_empty = False

    def finish(self, ledger: ReadingLedger) -> dict[str, Column]:
        """Return all columns, and note the dropped messages in the ledger.

        Raises:
            InputError: No message of the topic could be used, or its messages have several types.
        """
        types = {topic.type_name for topic in self.definitions}  # one without messages does not count
        if len(types) > 1:
            raise InputError(
                f"{ledger.path}: {self.adapter.role}: topic {self.topic_name} carries several types "
                f"({', '.join(sorted(types))}); name another topic in conf/machine"
            )
        if self.is_empty:
            raise InputError(self._why_nothing(ledger))
        for reason, count in self.reasons.items():
            which = f"{counted(count, 'message')} of {self.topic_name} ({self.adapter.role})"
            ledger.notes.append(Note(NoteKind.left_out, f"{which} left out: {reason}", count))
        return self.store.columns(self.table)

    def _why_nothing(self, ledger: ReadingLedger) -> str:
        place = f"{ledger.path}: {self.adapter.role}"
        damage = first_damage(ledger.notes)
        if self.reasons:
            reason, count = self.reasons.most_common(1)[0]
            which = f"{counted(count, 'message')} of {self.topic_name}"
            return f"{place}: none of the {which} can be used: {reason}{damage}"
        seen = "; ".join(
            f"{name} ({', '.join(topic.type_name for topic in topics)}, {ledger.counts[name]} messages)"
            for name, topics in sorted(ledger.topics.items())
        )
        what = "has no messages" if self.topic_name in ledger.topics else "is not in the log"
        return (
            f"{place}: topic {self.topic_name} {what}, set it in conf/machine; seen: {seen or 'none'}{damage}"
        )
