"""What logs hold: streams (topics, tables, CAN frames) and their fields, over all logs of a folder."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.logs.messages.raw_log import NANOSECONDS, Note, first_damage

MAXIMUM_ELEMENTS = 64  # of a sequence that are kept apart
MAXIMUM_TEXTS = 8
MAXIMUM_STREAMS = 1000  # more are counted only, as are the names of more than `MAXIMUM_ELEMENTS` joints
RATE_OF = 4096  # messages of a stream in a log, by which its rate is measured


@dataclass
class FieldContents:
    """A field of a stream: its type, and what its values were.

    Attributes:
        type_name: As the log's definition calls it.
        low: Smallest finite value of each element, shape (n_elements,).
        high: Largest finite value of each element, shape (n_elements,).
        is_whole: Whether all finite values are whole numbers.
        texts: Distinct values of a text field, each as its elements; not more than `MAXIMUM_TEXTS`.
        unit: As the log states it.
    """

    type_name: str
    low: np.ndarray = field(default_factory=lambda: np.zeros(0))
    high: np.ndarray = field(default_factory=lambda: np.zeros(0))
    is_whole: bool = True
    texts: list[tuple[str, ...]] = field(default_factory=list)
    unit: str = ""

    @property
    def n_elements(self) -> int:
        """Number of values of the longest message."""
        return len(self.low)

    def add_numbers(self, values: np.ndarray) -> None:
        """Add values of shape (n, n_elements)."""
        values = values[:, :MAXIMUM_ELEMENTS].astype(np.float64)
        if not values.size:
            return
        finite = np.isfinite(values)
        low = np.where(finite, values, np.inf).min(axis=0)
        high = np.where(finite, values, -np.inf).max(axis=0)
        n_more = len(low) - len(self.low)
        if n_more > 0:
            self.low = np.concatenate([self.low, np.full(n_more, np.inf)])
            self.high = np.concatenate([self.high, np.full(n_more, -np.inf)])
        n = len(low)
        self.low[:n], self.high[:n] = np.minimum(self.low[:n], low), np.maximum(self.high[:n], high)
        self.is_whole = self.is_whole and bool((values[finite] == np.rint(values[finite])).all())

    def add_texts(self, texts: tuple[str, ...]) -> None:
        """Add the value of a text field."""
        if texts not in self.texts and len(self.texts) < MAXIMUM_TEXTS:
            self.texts.append(texts)


@dataclass
class Stream:
    """Messages of one topic, rows of one kind of table, or frames of one kind.

    Attributes:
        name: The topic, or what is in its place.
        type_name: The messages' type.
        fields: By path or column.
        names: Places of the joints in joint states by their names, in the order in which they were first met.
        n_messages: Over all logs.
        n_logs: Logs that hold it.
        intervals_s: Median interval between its messages, of each log.
        note: Why its fields are not known; empty if they are.
        n_of_log: Messages of the log that is being read.
        times_ns: Times of the first of them.
    """

    name: str
    type_name: str
    fields: dict[str, FieldContents] = field(default_factory=dict)
    names: dict[str, int] = field(default_factory=dict)
    n_messages: int = 0
    n_logs: int = 0
    intervals_s: list[float] = field(default_factory=list)
    note: str = ""
    n_of_log: int = 0
    times_ns: list[np.ndarray] = field(default_factory=list)

    @property
    def rate_hz(self) -> float:
        """Median rate, zero where it is not known."""
        interval = float(np.median(self.intervals_s)) if self.intervals_s else 0.0
        return 1.0 / interval if interval > 0 else 0.0

    def add_fields(self, types: Mapping[str, str]) -> None:
        """Add fields that are not there yet, by path."""
        for path, type_name in types.items():
            self.fields.setdefault(path, FieldContents(type_name))

    def add_times(self, times_ns: np.ndarray) -> None:
        """Add messages of a log by their times, shape (n,), int64."""
        if (n_more := RATE_OF - self.n_of_log) > 0:
            self.times_ns.append(times_ns[:n_more])
        self.n_of_log += len(times_ns)

    def end_log(self) -> None:
        """Count the messages of one log and measure their rate."""
        self.n_messages += self.n_of_log
        self.n_logs += 1
        times = np.sort(np.concatenate([np.zeros(0, np.int64), *self.times_ns]))
        if len(times) > 1:
            self.intervals_s.append(float(np.median(np.diff(times))) / NANOSECONDS)
        self.n_of_log, self.times_ns = 0, []


@dataclass
class Contents:
    """What a folder of logs holds.

    Attributes:
        streams: By name and type, or by the columns of a table.
        logs: A line for each log that was read.
        failures: A line for each that was not.
    """

    streams: dict[tuple[str, ...], Stream] = field(default_factory=dict)
    logs: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def add_log(self, text: str, notes: Iterable[Note]) -> None:
        """Add the line of a log that was read, with the first of its damage."""
        self.logs.append(f"{text}{first_damage(notes)}")

    def stream(self, key: tuple[str, ...], name: str, type_name: str) -> Stream:
        """Return the stream of a key, which is made when it is first met."""
        if key not in self.streams and len(self.streams) >= MAXIMUM_STREAMS:
            key, name, type_name = (), f"all others than the first {MAXIMUM_STREAMS}", ""
        return self.streams.setdefault(key, Stream(name, type_name))
