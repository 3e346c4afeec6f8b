"""Logs that nothing can be said of."""

from typing import Literal

from pipeline.errors import InputError


class UnusableLogs(InputError):
    """Why logs cannot be used, and which: who knows where they are from can say so."""

    def __init__(self, which: Literal["nominal", "measured"], why: str) -> None:
        super().__init__(f"{which} logs: {why}")
        self.which, self.why = which, why
