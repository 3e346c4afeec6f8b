"""What logs hold, as lines of text."""

from collections.abc import Iterator

from pipeline.errors import counted
from pipeline.logs.describe.contents import Contents, FieldContents, Stream

SHOWN_ELEMENTS = 8


def listing(contents: Contents) -> Iterator[str]:
    """Yield a line for each log, then each stream with its fields."""
    for line in _lines(contents):
        yield "".join(letter if letter.isprintable() else "�" for letter in line)


def _lines(contents: Contents) -> Iterator[str]:
    yield from contents.logs
    yield from (f"not read: {line}" for line in contents.failures)
    for stream in sorted(contents.streams.values(), key=lambda one: one.name):
        yield ""
        yield f"{stream.name}: {_summary(stream)}"
        width = max((len(path) for path in stream.fields), default=0)
        for path, content in stream.fields.items():
            yield f"  {path:<{width}}  {content.type_name}{_values(content)}".rstrip()
        if stream.note:
            yield f"  ({stream.note})"


def _summary(stream: Stream) -> str:
    rate = f", {stream.rate_hz:.4g} Hz" if stream.rate_hz else ""
    logs = f", in {stream.n_logs} logs" if stream.n_logs > 1 else ""
    return f"{stream.type_name or 'of no named type'}, {counted(stream.n_messages, 'message')}{rate}{logs}"


def _values(content: FieldContents) -> str:
    unit = f" {content.unit}" if content.unit else ""
    if content.texts:
        names = max(content.texts, key=len)
        more = f" and {len(names) - SHOWN_ELEMENTS} more" if len(names) > SHOWN_ELEMENTS else ""
        return f"  {', '.join(names[:SHOWN_ELEMENTS])}{more}"
    ranges = [
        "no number" if low > high else f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
        for low, high in zip(content.low, content.high, strict=True)
    ]
    more = f" and {len(ranges) - SHOWN_ELEMENTS} more" if len(ranges) > SHOWN_ELEMENTS else ""
    return f"  {'; '.join(ranges[:SHOWN_ELEMENTS])}{more}{unit}" if ranges else unit
