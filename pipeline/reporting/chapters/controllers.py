"""The report's chapters on the controllers: evaluation results and films."""

import statistics
from collections.abc import Mapping, Sequence

from pipeline.reporting.page import Figure, Points, Section
from pipeline.reporting.results.controllers import ControllerResult, by_controller
from pipeline.reporting.tables.evaluation import comparison_table, differences

FOLD_ABOVE = 4  # sentences; a longer list is folded
FILMS_TITLE = "What it looks like"


def film_section(films: Mapping[str, Figure], unavailable: str | None) -> Section:
    """A film per controller, or the reason why films are missing."""
    if not films:
        return Section(
            FILMS_TITLE, f"No picture: {unavailable}" if unavailable else "No controller was evaluated."
        )
    return Section(
        FILMS_TITLE,
        "The same evaluation episode, the first one, with each controller, on the learned model and in real time.",
        list(films.values()),
        paragraphs=[
            "The translucent sector is the restricted workspace W+, the bars beneath are the grill; the green hammer "
            "is the target pose, the red line the way so far. Below: distance and pitch error (lines at the precisions "
            "that the tables report), and the command of each joint, forward in blue, backward in orange."
        ],
        gallery=True,
    )


def controller_section(
    controllers: Sequence[ControllerResult], figures: Mapping[str, Figure], origin: str
) -> Section:
    """Evaluation results of the controllers beside the paper's."""
    sentences = differences(controllers, origin)
    points = []
    if sentences:
        title = f"Where ours differ from the paper's by more than the scatter over seeds ({len(sentences)})"
        points.append(Points(title, sentences, folded=len(sentences) > FOLD_ABOVE))
    return Section(
        "How well the controllers reach",
        f"{reaching_answer(controllers)}, on the learned model.",
        list(figures.values()),
        [comparison_table(controllers, origin)],
        points=points,
    )


def reaching_answer(controllers: Sequence[ControllerResult]) -> str:
    """Success rate of each controller at the coarse precision, mean over seeds."""
    rates = [
        f"{group[0].title} {100 * mean_of(group, 'sr_012_008'):.0f} %"
        for group in by_controller(controllers).values()
    ]
    return f"Within 0.12 m and 0.08 rad of the target, in the share of episodes: {', '.join(rates)}"


def mean_of(group: Sequence[ControllerResult], metric: str) -> float:
    """A metric's mean over seeds."""
    return statistics.fmean(controller.metrics[metric] for controller in group)


def evaluated(group: Sequence[ControllerResult]) -> dict[str, float]:
    """Metrics of `metrics.json`, averaged over seeds, for the pipeline's MLflow run."""
    return {
        key: mean_of(group, key) for key, value in group[0].metrics.items() if isinstance(value, int | float)
    }
