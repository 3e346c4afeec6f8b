"""`make demo`: from logs to reaching, and to what has changed, in one process and some minutes, ending on one page.

The steps are the stages' own commands. In a process each they would import the libraries anew.
"""

import importlib
import shlex
import sys
import time
from pathlib import Path
from unittest import mock

from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_machine, load_section
from pipeline.dynamics.judgement import long_prediction
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.effects.store import load_predictor
from pipeline.files.atomic import write_whole
from pipeline.logs.ingest_config import IngestConfig
from pipeline.logs.trajectories import load_trajectories
from pipeline.reporting.pages.demo import DemoStep, demo_page

MACHINE = "bobcat_e10"
FOLDER = Path("build/demo")
EFFECT_SEED = 11  # of the change's kind, joint and size; chosen so that a model can be corrected by it
PREDICTED_STEPS = 400  # 20 s
STEPS = (
    (
        "Record twelve minutes of the machine as it is",
        f"record profile=smoke 'record.session_minutes=[6,6]' output={FOLDER}/old",
    ),
    (
        "Change the machine, seal what changed, and record eight minutes",
        "record_changed profile=smoke 'record_changed.session_minutes=[4,4]' 'effects=[drawn]' "
        f"effects_seed={EFFECT_SEED} recorded={FOLDER}/old/sessions output={FOLDER}/new",
    ),
    (
        "Turn the bags into tuples, and check their quality",
        f"ingest profile=smoke logs={FOLDER}/old/sessions output={FOLDER}/tuples report={FOLDER}/quality",
    ),
    (
        "Learn a model of the machine's motion",
        f"identify profile=smoke tuples={FOLDER}/tuples output={FOLDER}/model checkpoints=null "
        "'identify.selected.mlp_dqdot={hidden:[64,64],learning_rate:4.0e-3,maximum_epochs:20}'",
    ),
    (
        "Reach targets by planning on the model",
        f"evaluate_icem profile=default model={FOLDER}/model variant=icem icem.first_episodes=4 episodes.steps=200 "
        f"episodes.table_rows=4096 icem.chunk_episodes=4 checkpoints=null output={FOLDER}/reaching",
    ),
    (
        "Close the loop: what do the new logs show that the model lacks?",
        f"close_loop profile=smoke nominal={FOLDER}/old/sessions measured={FOLDER}/new/sessions "
        f"model={FOLDER}/model output={FOLDER}/loop",
    ),
    (
        "Open the seal",
        f"unseal closed_loop={FOLDER}/loop/closed_loop.json measured={FOLDER}/new/sessions "
        f"seal={FOLDER}/new/undeclared.seal output={FOLDER}/loop/judgement.json",
    ),
)


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
    with mock.patch.object(sys, "argv", [f"{stage}.py", *overrides, "tracking=none"]):
        importlib.import_module(f"pipeline.stages.{stage}").main()


def draw(steps: list[DemoStep]) -> str:
    """The page, with the model's predictions of a new log before and after."""
    machine = load_machine(MACHINE)
    control = load_section("control", ControlConfiguration, "smoke")
    measured = load_trajectories(
        FOLDER / "new/sessions", machine, load_section("ingest", IngestConfig, "smoke"), control.loop_tracker
    )
    predictions = {
        when: long_prediction(
            load_predictor(FOLDER / f"loop/model_{when}", machine=machine),
            measured,
            FIRST_JUDGED_ROW,
            PREDICTED_STEPS,
        )
        for when in ("before", "after")
    }
    return demo_page(machine, MACHINE_DIRECTORY, FOLDER, predictions, steps)


if __name__ == "__main__":
    main()
