"""Progress of long work, on a terminal and in a log."""

import sys

from tqdm import tqdm


def progress_bar(description: str, total: int, unit: str) -> tqdm:
    """A progress bar on standard error; in a log file it prints a line every half minute instead of redrawing."""
    interval_s = 0.2 if sys.stderr.isatty() else 30.0
    return tqdm(
        total=total, desc=description, unit=unit, mininterval=interval_s, maxinterval=interval_s, leave=True
    )
