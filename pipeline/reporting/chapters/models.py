"""The report's chapters on the models: prediction errors, and comparison with standard references."""

from collections.abc import Mapping, Sequence

from pipeline.machine.specification import MachineSpecification
from pipeline.reporting.closed_loop.quantities import significant
from pipeline.reporting.figures.arrays import open_loop_figure
from pipeline.reporting.page import SVG, Figure, Section
from pipeline.reporting.results.artifacts import JudgementResult, ModelResult
from pipeline.reporting.results.paper import KIND_NAMES, SELECTED_MODELS, machine_note
from pipeline.reporting.table import Table


def model_section(machine: MachineSpecification, models: Sequence[ModelResult], origin: str) -> Section:
    """Prediction errors of the identified models beside a linear ARX."""
    tables = [selected_models_table(models, origin)] + [error_table(machine, model) for model in models]
    first = models[0].open_loop
    predicted = {KIND_NAMES[model.kind]: model.open_loop["predicted"] for model in models}
    steps = len(first["t_s"])
    figure = Figure(
        "Open-loop prediction",
        f"From one measured history, {steps} steps ({steps * machine.dt_s:.0f} s) of recorded commands; "
        f"the model sees no measurement after the start. Recording {first['trajectory']}; "
        f"judged {judged_on(models[0])}.",
        open_loop_figure(
            first["t_s"], first["measured"], first["commands"], predicted, machine.joint_names, machine.units
        ),
        SVG,
    )
    errors = models[0].metrics["model"]["open_loop_rmse_80"]
    worst, unit = worst_joint(machine, errors)
    return Section(
        "How well the model predicts",
        f"After up to four seconds without a measurement the worst joint relative to its range ({worst}) is off by "
        f"{errors[worst]:.3f} {unit} (root mean square, {judged_on(models[0])}).",
        [figure],
        tables,
    )


def judgement_section(judgement: JudgementResult) -> Section:
    """A model beside the standard references."""
    figures = [
        Figure(
            "Error over the horizon",
            "Root mean square error after each horizon, with 95 % bands (block bootstrap).",
            content,
            SVG,
        )
        for name, content in judgement.figures.items()
        if name == "error_growth"
    ]
    tables = {
        name: Table(
            content["title"],
            list(content["rows"][0]),
            [list(row.values()) for row in content["rows"]],
            content["notes"],
        )
        for name, content in judgement.comparisons.items()
    }
    sentences = {name: content["sentence"] for name, content in judgement.comparisons.items()}
    return Section(
        f"{KIND_NAMES[judgement.kind]} beside a control engineer's references",
        f"Prediction: {sentences['errors']}",
        figures,
        [tables["errors"]],
        [
            f"Over the horizon: {sentences['error_growth']}",
            f"Outside the training distribution, where a policy exploits what is wrong: {sentences['extrapolation']}",
        ],
        folded_tables=[table for name, table in tables.items() if name != "errors"],
    )


def selected_models_table(models: Sequence[ModelResult], origin: str) -> Table:
    """The paper's table of selected dynamics models, with ours beside it."""
    rows = []
    for model in models:
        published = SELECTED_MODELS.get(model.kind)
        rows.append(
            [
                KIND_NAMES[model.kind],
                f"{model.architecture}, k = {model.specification['lags']}",
                f"{model.metrics['evaluation_loss']:.2e}",
                f"{published[0]}, k = {published[1]}" if published else "–",
                f"{published[5]:.2e}" if published else "–",
            ]
        )
    columns = ["Prediction", "Ours", "L|eval at H = 80 [rad²]", "Paper", "its L|eval at H = 80 [rad²]"]
    return Table("Dynamics models", columns, rows, [machine_note(origin)])


def error_table(machine: MachineSpecification, model: ModelResult) -> Table:
    """One-step and open-loop RMSE per joint, model beside ARX (contract, section 3)."""
    rows = [
        [
            f"{joint} [{unit}]",
            *(
                significant(model.metrics[predictor][error][joint])
                for error in ("one_step_rmse", "open_loop_rmse_80")
                for predictor in ("model", "arx")
            ),
        ]
        for joint, unit in zip(machine.joint_names, machine.units, strict=True)
    ]
    name = KIND_NAMES[model.kind]
    columns = ["Joint", f"One step, {name}", "One step, ARX", f"4 s open loop, {name}", "4 s open loop, ARX"]
    n_steps, n_windows = model.metrics["n_steps"], model.metrics["n_windows"]
    counts = f"{n_steps} steps and {n_windows} windows of 80 steps, {judged_on(model)}"
    return Table(
        f"Prediction error (RMSE): {counts}", columns, rows, ["ARX: linear, with the same lags and inputs."]
    )


def worst_joint(machine: MachineSpecification, errors: Mapping[str, float]) -> tuple[str, str]:
    """The joint with the largest error in units of its range, and the unit of its position."""
    joint = max(machine.joints, key=lambda joint: errors[joint.name] / (joint.upper - joint.lower))
    return joint.name, machine.units[machine.joint_names.index(joint.name)]


def judged_on(model: ModelResult) -> str:
    """The rows on which the model's errors were measured, in words."""
    if model.lineage["judged_on"] == "held_out":
        return "on a recording that neither training nor selection saw"
    return "on validation rows, which early stopping saw"
