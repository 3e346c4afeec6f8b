"""The report's chapters, from what the stages left: tables, figures, and one sentence of answer each."""

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.logs.tuples import Trajectory
from pipeline.machine.kinematics import Arm
from pipeline.machine.specification import MachineSpecification
from pipeline.reaching.metrics import PITCH_THRESHOLDS_RAD, POSITION_THRESHOLDS_M
from pipeline.reporting.clouds import cloud_of
from pipeline.reporting.figures import (
    LearningCurve,
    learning_curve_figure,
    open_loop_figure,
    success_rate_figure,
)
from pipeline.reporting.page import Figure, KeyFigure, Section
from pipeline.reporting.paper import BRAX_EVALUATION_COLUMNS, KIND_NAMES, PPO_BRAX_EVALUATION, SELECTED_MODELS
from pipeline.reporting.results import (
    ControllerResult,
    JudgementResult,
    ModelResult,
    PipelineResults,
)
from pipeline.reporting.tables import Table, mean_and_deviation
from pipeline.reporting.workspace_figures import cloud_figure

SVG, PNG = "image/svg+xml", "image/png"
# Whose machine our figures are of, beside the paper's.
SIMULATED = "The paper's machine is a real Bobcat E10, ours a simulated one with assumed geometry."
OWN = "The paper's machine is a Bobcat E10, ours another."
EVALUATION_METRICS = ("average_return", "sr_002_002", "sr_004_004", "oow", "ooz", "min_z_m")


def data_section(
    machine: MachineSpecification, arm: Arm | None, trajectories: Sequence[Trajectory]
) -> Section:
    """What was learnt from: the recordings, and where in the workspace they were."""
    rows = [
        [
            trajectory.name,
            f"{len(trajectory) * machine.dt_s / 60:.1f}",
            str(len(trajectory)),
            f"{100 * np.mean(np.any(trajectory.a != 0, axis=1)):.0f} %",
        ]
        for trajectory in trajectories
    ]
    table = Table("Recordings to learn from", ["Recording", "Minutes", "Steps", "Steps with a command"], rows)
    figures = []
    if arm is not None and machine.workspace is not None:
        clouds = {trajectory.name: cloud_of(arm, trajectory.q) for trajectory in trajectories}
        figures.append(
            Figure(
                "End-effector positions while teleoperated",
                "Seen from above and from the side, coloured by pitch; outlined is the restricted workspace W+.",
                cloud_figure(clouds, machine.workspace),
                PNG,
            )
        )
    minutes = sum(len(trajectory) for trajectory in trajectories) * machine.dt_s / 60
    return Section(
        "What it learnt from",
        f"{len(trajectories)} recordings, {minutes:.0f} minutes of joint angles and commands; nothing "
        "else was measured.",
        figures,
        [table],
    )


def model_section(machine: MachineSpecification, models: Sequence[ModelResult], origin: str) -> Section:
    """How well the identified models predict, beside a linear ARX."""
    tables = [selected_models_table(models, origin)] + [error_table(machine, model) for model in models]
    first = models[0].open_loop
    predicted = {KIND_NAMES[model.kind]: model.open_loop["predicted"] for model in models}
    steps = len(first["t_s"])
    figure = Figure(
        "Open-loop prediction",
        f"From one measured history, {steps} steps ({steps * machine.dt_s:.0f} s) of recorded commands; "
        f"the model sees no measurement after the start. Recording {first['trajectory']}, {judged_on(models[0])}.",
        open_loop_figure(
            first["t_s"], first["measured"], first["commands"], predicted, machine.joint_names, machine.units
        ),
        SVG,
    )
    errors = models[0].metrics["model"]["open_loop_rmse_80"]
    worst, unit = worst_joint(machine, errors)
    return Section(
        "How well the model predicts",
        f"After up to four seconds without a measurement the worst joint ({worst}) is off by "
        f"{errors[worst]:.3f} {unit} (root mean square, {judged_on(models[0])}).",
        [figure],
        tables,
    )


def judgement_section(judgement: JudgementResult) -> Section:
    """A model beside the references that a control engineer would try first."""
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
    tables = [
        Table(
            content["title"],
            list(content["rows"][0]),
            [list(row.values()) for row in content["rows"]],
            content["notes"],
        )
        for content in judgement.comparisons.values()
    ]
    sentences = {name: content["sentence"] for name, content in judgement.comparisons.items()}
    return Section(
        f"{KIND_NAMES[judgement.kind]} beside a control engineer's references",
        f"Prediction: {sentences['errors']}",
        figures,
        tables,
        [
            f"Over the horizon: {sentences['error_growth']}",
            f"Outside the training distribution, where a policy exploits what is wrong: {sentences['extrapolation']}",
        ],
    )


def controller_section(results: PipelineResults, origin: str) -> Section:
    """How well the policies reach, beside the paper's."""
    kinds = sorted({controller.kind for controller in results.controllers})
    curves, rates = {}, {}
    for kind in kinds:
        controllers = results.controllers_of(kind)
        name = f"PPO {KIND_NAMES[kind]}"
        curves[name] = LearningCurve(
            np.array([point["steps"] for point in controllers[0].curve]),
            np.array([[point["average_return"] for point in controller.curve] for controller in controllers]),
        )
        rates[name] = np.mean([controller.success_rates for controller in controllers], axis=0)
    figures = [
        Figure(
            "Success rates",
            "Share of the evaluation episodes in which both errors fell below their thresholds at the same step, "
            "mean over seeds.",
            success_rate_figure(rates, np.array(POSITION_THRESHOLDS_M), np.array(PITCH_THRESHOLDS_RAD)),
            SVG,
        ),
        Figure(
            "Learning curves",
            "Average return over fixed episodes that the evaluation does not use; each seed as a thin line.",
            learning_curve_figure(curves),
            SVG,
        ),
    ]
    rates_at = [controller.metrics["sr_012_008"] for controller in results.controllers]
    return Section(
        "How well the policies reach",
        f"Within 0.12 m and 0.08 rad of the target in {100 * float(np.mean(rates_at)):.0f} % of the episodes, "
        f"on the learned model ({len(results.controllers)} independently trained policies).",
        figures,
        [brax_evaluation_table(results, origin)],
    )


def selected_models_table(models: Sequence[ModelResult], origin: str) -> Table:
    """The paper's table of selected dynamics models, ours beside its."""
    rows = []
    for model in models:
        published = SELECTED_MODELS[model.kind]
        rows.append(
            [
                KIND_NAMES[model.kind],
                f"{model.architecture}, k = {model.specification['lags']}",
                f"{model.metrics['evaluation_loss']:.2e}",
                f"{published[0]}, k = {published[1]}",
                f"{published[5]:.2e}",
            ]
        )
    columns = ["Prediction", "Ours", "L|eval at H = 80 [rad²]", "Paper", "its L|eval at H = 80 [rad²]"]
    return Table("Dynamics models", columns, rows, [origin])


def error_table(machine: MachineSpecification, model: ModelResult) -> Table:
    """One-step and open-loop RMSE per joint, model beside ARX (contract, section 3)."""
    rows = [
        [
            f"{joint} [{unit}]",
            *(
                _scientific(model.metrics[predictor][error][joint])
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


def brax_evaluation_table(results: PipelineResults, origin: str) -> Table:
    """The paper's table of evaluation results in the Brax environment, ours beside its."""
    rows = []
    for kind in sorted({controller.kind for controller in results.controllers}):
        controllers = results.controllers_of(kind)
        ours = [
            mean_and_deviation([controller.metrics[key] for controller in controllers])
            for key in EVALUATION_METRICS
        ]
        reached = mean_and_deviation([controller.metrics["sr_012_008"] for controller in controllers])
        length = mean_and_deviation([controller.metrics["path_length_m"] for controller in controllers])
        rows.append([f"PPO {KIND_NAMES[kind]}", "ours", str(len(controllers)), *ours, reached, length])
        rows.append([f"PPO {KIND_NAMES[kind]}", "paper", "5", *PPO_BRAX_EVALUATION[kind], "–", "–"])
    columns = ["Controller", "Whose", "Seeds", *BRAX_EVALUATION_COLUMNS, "SR(0.12, 0.08)", "EEF-PL [m]"]
    n_episodes = int(results.controllers[0].metrics["n_episodes"])
    notes = [
        "Mean ± standard deviation over seeds. OOW, OOZ: share of episodes that left the restricted "
        "workspace, or its lower plane, at any step. EEF-PL: path length of the end effector.",
        "Joint limits act as end stops in our environment; the paper is silent on them.",
        origin,
    ]
    return Table(f"Evaluation in the Brax environment over {n_episodes} episodes", columns, rows, notes)


def key_figures(machine: MachineSpecification, results: PipelineResults) -> list[KeyFigure]:
    """The handful of numbers to see first."""
    figures = []
    if results.controllers:
        for key, label in (("sr_012_008", "0.12 m, 0.08 rad"), ("sr_002_002", "0.02 m, 0.02 rad")):
            rate = float(np.mean([controller.metrics[key] for controller in results.controllers]))
            figures.append(KeyFigure(f"{100 * rate:.0f} %", f"of episodes reach the target within {label}"))
        below = float(np.mean([controller.metrics["ooz"] for controller in results.controllers]))
        figures.append(KeyFigure(f"{100 * below:.0f} %", "of episodes go below the grill's plane"))
    errors = results.models[0].metrics["model"]["open_loop_rmse_80"]
    worst, unit = worst_joint(machine, errors)
    figures.append(
        KeyFigure(f"{errors[worst]:.3f} {unit}", f"4-second prediction error of the worst joint ({worst})")
    )
    return figures


def verdict(results: PipelineResults, profile: str) -> str:
    """What was done and whether to trust it."""
    if profile == "smoke":
        return "A smoke run: everything ran on tiny data for seconds. None of its figures means anything."
    text = f"{len(results.models)} dynamics model(s) identified from teleoperation logs"
    if results.controllers:
        rate = 100 * float(np.mean([controller.metrics["sr_012_008"] for controller in results.controllers]))
        text += f"; {len(results.controllers)} reaching policies learnt on them, which reach {rate:.0f} % "
        text += "of the targets within 0.12 m and 0.08 rad"
    return (
        f"{text}. Policies were tried on the learned model, not on a machine: how much the model "
        "leaves out is what the prediction errors below tell."
    )


def worst_joint(machine: MachineSpecification, errors: Mapping[str, float]) -> tuple[str, str]:
    """The joint with the largest error in units of its range, and the unit of its position."""
    joint = max(machine.joints, key=lambda joint: errors[joint.name] / (joint.upper - joint.lower))
    return joint.name, machine.units[machine.joint_names.index(joint.name)]


def judged_on(model: ModelResult) -> str:
    """On which rows the model's errors were measured."""
    if model.lineage["judged_on"] == "held_out":
        return "on a recording that neither training nor selection saw"
    return "on validation rows, which early stopping saw"


def evaluated(controllers: Sequence[ControllerResult]) -> Mapping[str, float]:
    """Metrics averaged over controllers, for the pipeline's run."""
    keys = controllers[0].metrics
    return {key: float(np.mean([controller.metrics[key] for controller in controllers])) for key in keys}


def _scientific(value: float) -> str:
    return f"{value:.3g}"
