"""Progress of long work, on a terminal and in a log, and how fast simulated time goes by."""

import sys
import time

from tqdm import tqdm


class ProgressBar(tqdm):
    """A bar that is told how much is done in total."""

    def reach(self, done: float, **shown: str) -> None:
        """Show that so much of the total is done, in whole units, and values; what goes beyond it is not shown."""
        if shown:
            self.set_postfix(shown, refresh=False)
        self.update(min(round(done), self.total) - self.n)


def progress_bar(description: str, total: int, unit: str) -> ProgressBar:
    """A progress bar on standard error; in a log file it prints a line every half minute instead of redrawing."""
    interval_s = 0.2 if sys.stderr.isatty() else 30.0
    return ProgressBar(
        total=total, desc=description, unit=unit, mininterval=interval_s, maxinterval=interval_s, leave=True
    )


class Stopwatch:
    """Measures how fast simulated time goes by, compilation and all."""

    def __init__(self) -> None:
        self._start_s, self._start_processor_s = time.perf_counter(), time.process_time()

    def speed(self, simulated_s: float) -> str:
        """What so much of simulated time has taken since the beginning, in words."""
        taken_s = time.perf_counter() - self._start_s
        processor_s = time.process_time() - self._start_processor_s
        return (
            f"{simulated_s:.0f} s of the graph in {taken_s:.0f} s, {simulated_s / taken_s:.0f} x real time "
            f"({processor_s:.0f} s of processor time)"
        )
