"""Overrides for commands that a stage starts: its own, and what it has other than they by default."""

from collections.abc import Mapping, Sequence

from hydra.core.override_parser.types import Quote, QuotedString

Scalar = str | float | None  # to a type checker, a whole number and a truth value are float, too


def override(key: str, value: Scalar) -> str:
    """The word that sets a key to a value, quoted so that Hydra reads just that value, whatever stands in it."""
    if value is None:
        return f"{key}=null"
    return (
        f"{key}={QuotedString(str(value), Quote.single).with_quotes() if isinstance(value, str) else value}"
    )


def replaced(overrides: Sequence[str], own: Mapping[str, Scalar]) -> list[str]:
    """Overrides with values of one's own in place of theirs, or beside them."""
    others = [word for word in overrides if _key(word) not in own]
    return [*others, *(override(key, value) for key, value in own.items())]


def _key(word: str) -> str:
    return word.partition("=")[0].lstrip("+~")
