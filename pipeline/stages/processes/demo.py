"""`make demo`: from logs to reaching, and to what has changed, in one process and some minutes, ending on one page.

The steps are the stages' own commands. In a process each they would import the libraries anew.
"""

import importlib
import shlex
import sys
import time

from pipeline.configuration.from_python import read_logs
from pipeline.configuration.load import MACHINE_DIRECTORY, load_machine
from pipeline.dynamics.judgement import long_prediction
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.effects.store import load_predictor
from pipeline.files.atomic import write_whole
from pipeline.reporting.pages.demo import DemoStep, demo_page
from pipeline.stages.processes.demo_steps import FOLDER, STEPS

MACHINE = "bobcat_e10"
PREDICTED_STEPS = 400  # 20 s


def main() -> None:
    """Run every step, then write the page."""
    began, done = time.monotonic(), []
    for title, command in STEPS:
        start = time.monotonic()
        say(start - began, title)
        run(command)
        words = f"python -m pipeline.stages.{command}"
        done.append(DemoStep(title, words, time.monotonic() - start))
    say(time.monotonic() - began, "Draw the page")
    page = FOLDER / "index.html"
    write_whole(page, draw(done).encode())
    say(time.monotonic() - began, f"Done. Open {page}")


def say(seconds: float, sentence: str) -> None:
    """With the time since the start before it."""
    print(f"\n[{int(seconds) // 60}:{int(seconds) % 60:02d}] {sentence}", flush=True)


def run(command: str) -> None:
    """A stage's command in this process; a failed one ends it."""
    stage, *overrides = shlex.split(command)
    sys.argv = [f"{stage}.py", *overrides, "tracking=none"]
    importlib.import_module(f"pipeline.stages.{stage}").main()


def draw(steps: list[DemoStep]) -> str:
    """The page, with the model's predictions of a new log before and after."""
    machine = load_machine(MACHINE)
    measured = read_logs(machine, FOLDER / "new/sessions", "smoke")
    predictions = {
        when: long_prediction(
            load_predictor(FOLDER / f"loop/model_{when}", machine=machine),
            measured,
            FIRST_JUDGED_ROW,
            PREDICTED_STEPS,
        )
        for when in ("after", "before")  # in the colours of the report
    }
    return demo_page(machine, MACHINE_DIRECTORY, FOLDER, predictions, steps)


if __name__ == "__main__":
    main()
