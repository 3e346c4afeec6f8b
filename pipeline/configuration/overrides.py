"""Overrides for commands that a stage starts: its own, and what it has other than they by default."""

from collections.abc import Mapping, Sequence
from typing import Any

from hydra.core.hydra_config import HydraConfig
from hydra.core.override_parser.types import Quote, QuotedString

Scalar = str | float | None  # to a type checker, a whole number and a truth value are float, too

INTERPOLATION = "${"


def override(key: str, value: Scalar) -> str:
    """The word that sets a key to a value, quoted so that Hydra reads just that value, whatever stands in it."""
    if value is None:
        return f"{key}=null"
    return (
        f"{key}={QuotedString(str(value), Quote.single).with_quotes() if isinstance(value, str) else value}"
    )


def of_this_job(configuration: object) -> list[str]:
    """What this command was given; in a sweep, what this job of it was.

    Args:
        configuration: of this job.
    """
    return settled(HydraConfig.get().overrides.task, configuration)


def settled(overrides: Sequence[str], configuration: object) -> list[str]:
    """Overrides with values in place of interpolations: to another command `${hydra:job.num}` means nothing.

    Args:
        overrides: of a command.
        configuration: of the same command.
    """
    words = []
    for word in overrides:
        value: Any = configuration
        for name in _key(word).split("."):
            value = getattr(value, name, None)
        is_open = INTERPOLATION in word and isinstance(value, str | int | float)
        words.append(override(_key(word), value) if is_open else word)
    return words


def replaced(overrides: Sequence[str], own: Mapping[str, Scalar]) -> list[str]:
    """Overrides with values of one's own in place of theirs, or beside them."""
    others = [word for word in overrides if _key(word) not in own]
    return [*others, *(override(key, value) for key, value in own.items())]


def _key(word: str) -> str:
    return word.partition("=")[0].lstrip("+~")
