"""The page that `make demo` ends on: films of reaching, and the change that was found in the machine."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.dynamics.judgement import OpenLoopPrediction
from pipeline.machine.offscreen import RenderingUnavailableError
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.episodes import load_episodes
from pipeline.reaching.metrics import load_traces, success
from pipeline.reporting.chapters.closed_loop import closed_loop_section, grade
from pipeline.reporting.closed_loop.quantities import readable_unit, significant
from pipeline.reporting.closed_loop.verdict import affected_joints, held_out_error
from pipeline.reporting.figures.film import episode_film, film_bytes
from pipeline.reporting.figures.models import open_loop_prediction_figure
from pipeline.reporting.page import SVG, WEBP, Figure, KeyFigure, Section, render_page
from pipeline.reporting.results.artifacts import read_closed_loop
from pipeline.reporting.table import Table

PLANNER = "iCEM, planning on the learned model"
WITHIN = (0.12, 0.08)  # m and rad: the coarsest precision of the paper's tables
FILMS, FRAMES_PER_SECOND = 3, 4  # so few because a computer without a GPU draws some ten pictures a second


@dataclass(frozen=True)
class DemoStep:
    """One step of the demonstration: what it did, the command that does the same, and how long it took."""

    title: str
    command: str
    seconds: float


def demo_page(
    machine: MachineSpecification,
    machine_directory: Path,
    folder: Path,
    predictions: Mapping[str, OpenLoopPrediction],
    steps: Sequence[DemoStep],
) -> str:
    """Lay out the page.

    Args:
        machine: The machine; it has a robot description.
        machine_directory: Where `conf/machine` lies.
        folder: Holds `reaching` of evaluate_icem, and `loop` of close_loop and unseal.
        predictions: Of the same measured rows by the model before and after.
        steps: What was done, in order.
    """
    reached, reaching = reaching_section(machine, machine_directory, folder / "reaching")
    result = read_closed_loop(folder / "loop")
    document = result.document
    loop = closed_loop_section(machine, result, folder)
    figure = Figure(
        "The model before and after",
        "Both predict twenty seconds of a new log from its commands alone. These rows were also used to find the "
        "effect; the table's errors are on rows that were not.",
        open_loop_prediction_figure(predictions, machine.joint_names, machine.units),
        SVG,
    )
    changed = Section("What has changed", loop.answer, [figure], loop.tables, loop.paragraphs)
    seconds = sum(step.seconds for step in steps)
    figures = [KeyFigure(reached, f"targets reached within {WITHIN[0]:g} m and {WITHIN[1]:g} rad")]
    for joint in affected_joints(document)[:1]:
        factor, unit = readable_unit(dict(zip(machine.joint_names, machine.units, strict=True))[joint])
        before, after = (
            significant(factor * held_out_error(document, w, joint), 2) for w in ("before", "after")
        )
        figures.append(
            KeyFigure(f"{before} → {after} {unit}", f"4-second error of the {joint}, before and after")
        )
    if "verdict_right" in result.judgement:
        word = grade(result.judgement).partition(":")[0]
        figures.append(KeyFigure(word, "verdict on what has changed, checked against the seal"))
    figures.append(KeyFigure(f"{seconds / 60:.1f} min", "for all of it"))
    return render_page(
        f"From logs of a hydraulic arm ({machine.name}) to reaching, and to what has changed",
        "A model was learned from logs of the simulated machine, and a planner drives the arm to targets on it. Then "
        "the machine was changed, the change was sealed, and new logs were searched for it. A seed draws what changes; "
        "this seed was chosen so that a model can be corrected. How often such a search is right: docs/benchmark.md.",
        figures,
        [reaching, changed, _steps_section(steps)],
        [
            ("logs", "recorded on the simulated machine, no real one"),
            ("settings", "small budgets, as the commands above say: a first look, not the result"),
            ("made by", "make demo"),
        ],
    )


def reaching_section(
    machine: MachineSpecification, machine_directory: Path, evaluation: Path
) -> tuple[str, Section]:
    """How many of the targets were reached, `7 of 8`, and the films of the first episodes."""
    traces, episodes = load_traces(evaluation / "traces.npz"), load_episodes(evaluation / "episodes.npz")
    reached = np.any(success(traces, *WITHIN), axis=1).tolist()
    films, paragraphs = [], []
    for episode in range(min(len(reached), FILMS)):
        try:
            film = episode_film(
                machine, machine_directory, "iCEM", traces, episodes, episode, FRAMES_PER_SECOND
            )
        except RenderingUnavailableError as error:
            paragraphs.append(f"No films: {error}.")
            break
        content = film_bytes(film, FRAMES_PER_SECOND)
        films.append(Figure(f"Target {episode + 1}", f"{film.outcome.capitalize()}.", content, WEBP))
    count = f"{sum(reached)} of {len(reached)}"
    answer = f"{PLANNER}, reaches {count} targets within {WITHIN[0]:g} m and {WITHIN[1]:g} rad."
    paragraphs.append(
        "The green hammer is the target pose, the translucent sector the workspace that the tip may not leave. The arm "
        "moves as the learned model says; on the machine itself the model's errors and delays come on top."
    )
    return count, Section("Reaching", answer, films, paragraphs=paragraphs, gallery=True)


def _steps_section(steps: Sequence[DemoStep]) -> Section:
    rows = [[step.title, f"{step.seconds:.0f}\N{NO-BREAK SPACE}s", step.command] for step in steps]
    return Section(
        "What was done",
        "Each step is a command that you can run by hand; docs/tutorial.md explains them one by one.",
        tables=[Table("Steps", ["Step", "Time", "Command"], rows)],
    )
