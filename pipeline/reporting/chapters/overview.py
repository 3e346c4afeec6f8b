"""The top of the report: what was done, and how far to trust it."""

from collections.abc import Sequence

from markupsafe import Markup

from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.chapters.controllers import mean_of
from pipeline.reporting.chapters.models import judged_on, worst_joint
from pipeline.reporting.page import KeyFigure, Points, Section
from pipeline.reporting.results.artifacts import PipelineResults
from pipeline.reporting.results.controllers import ControllerResult, by_controller
from pipeline.reporting.results.paper import KIND_NAMES, machine_note
from pipeline.reporting.tables.counts import episodes_text, seeds_text
from pipeline.reporting.tables.deployment import transfers
from pipeline.reporting.tables.evaluation import differences

COARSE, FINE = ("sr_012_008", "0.12 m and 0.08 rad"), ("sr_002_002", "0.02 m and 0.02 rad")


def key_figures(machine: MachineSpecification, results: PipelineResults) -> list[KeyFigure]:
    """The headline figures: success rate of the best policy and planner, and the model's error."""
    figures = []
    for group in leading_controllers(results.controllers):
        for metric, within in (COARSE, FINE):
            rate = 100 * mean_of(group, metric)
            figures.append(
                KeyFigure(f"{rate:.0f} %", f"of episodes reach the target within {within} ({group[0].title})")
            )
    errors = results.models[0].metrics["model"]["open_loop_rmse_80"]
    worst, unit = worst_joint(machine, errors)
    figures.append(
        KeyFigure(
            f"{errors[worst]:.3f} {unit}",
            f"4-second prediction error of the worst joint relative to its range ({worst})",
        )
    )
    return figures


def leading_controllers(controllers: Sequence[ControllerResult]) -> list[list[ControllerResult]]:
    """The policy and the planner with the highest success rate at the fine precision."""
    best: dict[bool, list[ControllerResult]] = {}
    for group in by_controller(controllers).values():
        trained = bool(group[0].curve)
        if trained not in best or mean_of(group, FINE[0]) > mean_of(best[trained], FINE[0]):
            best[trained] = group
    return [best[trained] for trained in (True, False) if trained in best]


def verdict(results: PipelineResults, profile: str) -> str:
    """What was done and how far to trust it, in two sentences."""
    if profile == "smoke":
        return "A smoke run: everything ran on tiny data for seconds. None of its figures means anything."
    n_models = len(results.models)
    text = f"{n_models} dynamics model{'s' if n_models > 1 else ''} identified from teleoperation logs"
    for group in leading_controllers(results.controllers)[:1]:
        rate = 100 * mean_of(group, COARSE[0])
        text += f"; of the controllers made on {'them' if n_models > 1 else 'it'}, {group[0].title} reaches "
        text += f"{rate:.0f} % of the targets within {COARSE[1]}"
    if any(deployment.sim2real for deployment in results.deployments):
        return (
            f"{text}. Controllers were tried on the learned model, and through a graph with measured delays on the "
            "simulated machine, not on a real one."
        )
    return (
        f"{text}. Controllers were tried on the learned model, not on a machine: how much the model "
        "leaves out is what the prediction errors below tell."
    )


def overview_section(
    machine: MachineSpecification,
    results: PipelineResults,
    data: Section,
    closed_loop: Section,
    origin: str,
) -> Section:
    """What was done step by step, and evidence for and against trusting it.

    Args:
        results: outputs of the stages.
        data: the chapter on the recordings.
        closed_loop: the chapter on the changed machine.
        origin: `SIMULATED` or `OWN`.
    """
    return Section(
        "In two minutes",
        f"A hydraulic arm ({machine.name}) learns to reach target poses from nothing but logs of people operating it.",
        points=[
            Points("What was done", _done(results, data)),
            Points("Whether to trust it", _trust(machine, results, closed_loop, origin)),
        ],
    )


def _done(results: PipelineResults, data: Section) -> list[Markup]:
    names = ", ".join(f"{KIND_NAMES[model.kind]} as {model.architecture}" for model in results.models)
    sentences = [
        _point("Logs", data.answer),
        _point("Models", f"networks that predict the next motion from past motion and commands: {names}."),
    ]
    groups = by_controller(results.controllers)
    if groups:
        counts = ", ".join(
            f"{group[0].title} ({seeds_text(group)}, {episodes_text(group)} episodes)"
            for group in groups.values()
        )
        sentences.append(_point("Controllers", f"learned (APG, PPO) or planned (iCEM) on a model: {counts}."))
    return sentences


def _trust(
    machine: MachineSpecification, results: PipelineResults, closed_loop: Section, origin: str
) -> list[Markup]:
    errors = results.models[0].metrics["model"]["open_loop_rmse_80"]
    worst, unit = worst_joint(machine, errors)
    baseline = results.models[0].metrics["arx"]["open_loop_rmse_80"][worst]
    sentences = [
        _point(
            "The model",
            f"after up to four seconds without a measurement its worst joint relative to its range ({worst}) is off by "
            f"{errors[worst]:.3f} {unit}, a linear model by {baseline:.3f} {unit} ({judged_on(results.models[0])}).",
        )
    ]
    if results.controllers:
        n = len(differences(results.controllers, origin))
        sentences.append(
            _point(
                "The controllers",
                "the success rates at the top are on the learned model. On a machine expect lower ones: the paper's "
                "policy on MLP Δq̇ fell from 0.98 to 0.11 at 0.02 m and 0.02 rad when it drove through the graph.",
            )
        )
        if results.deployments:
            sentences.append(_point("Deployment", " ".join(transfers(results.deployments))))
        sentences.append(
            _point(
                "Beside the paper",
                f"{n} of the figures differ by more than the scatter over seeds; each has its sentence below. "
                f"{machine_note(origin)}",
            )
        )
    return [
        *sentences,
        _point("When the machine changes", " ".join([closed_loop.answer, *_plain(closed_loop)])),
    ]


def _plain(section: Section) -> list[str]:
    """The section's sentences without the link."""
    return [paragraph for paragraph in section.paragraphs if not isinstance(paragraph, Markup)]


def _point(lead: str, text: str) -> Markup:
    return Markup("<b>{}</b>: {}").format(lead, text)
