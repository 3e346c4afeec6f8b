"""What the steps of a run tell the user, and how long its parts take."""

import time
from collections.abc import Callable


class Journal:
    """Kept along one run, for its report.

    Attributes:
        sentences: In order, one or more per step.
        seconds: Wall-clock time by part.
    """

    def __init__(self, tell: Callable[[str], None] = lambda _: None) -> None:
        """Begin; `tell` is called with each sentence."""
        self.sentences: list[str] = []
        self.seconds: dict[str, float] = {}
        self._tell = tell
        self._begin = time.monotonic()

    def log(self, sentence: str) -> None:
        """Tell the user, and the report."""
        self.sentences.append(sentence)
        self._tell(sentence)

    def end_part(self, name: str) -> None:
        """Note how long a part took, which began where the last one ended."""
        now = time.monotonic()
        self.seconds[name] = now - self._begin
        self._begin = now
