"""Identification: a model is trained by back-propagation through time and judged beside a linear ARX."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.dynamics.evaluation.predictive_band import Coverage, PredictiveBand
from pipeline.dynamics.judgement import OpenLoopPrediction, check_unseen, judge, long_prediction
from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.fir.model import FirModel
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.dynamics.model.store import save_model
from pipeline.dynamics.references.arx import fit_arx
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.dynamics.training.data_split import VALIDATION, DataSplit
from pipeline.dynamics.training.fit import Progress, fit
from pipeline.dynamics.training.windows import FIRST_JUDGED_ROW
from pipeline.errors import InputError
from pipeline.machine.specification import MachineSpecification

BAND_STEPS = (20, 80)  # ahead, where the 90 % band is judged: 1 s and 4 s at 20 Hz


@dataclass(frozen=True)
class Identified:
    """An identified model and how well it predicts.

    Attributes:
        curves: Losses per epoch.
        metrics: Of the training, and errors of the model and of the ARX on the judged rows.
        lineage: What it was identified from.
        open_loop: A long prediction to look at.
    """

    model: DynamicsModel
    parameters: Parameters
    curves: dict[str, list[float]]
    metrics: dict[str, Any]
    lineage: dict[str, Any]
    open_loop: OpenLoopPrediction

    def save(self, output: Path) -> None:
        """Write the model folder."""
        save_model(output, self.model, self.parameters, self.lineage, self.metrics, self.curves)
        np.savez(output / "open_loop.npz", **asdict(self.open_loop))


def identify(
    rows: DataSplit,
    machine: MachineSpecification,
    parameterization: Parameterization,
    target: Target,
    settings: IdentifyConfig,
    progress: Progress | None = None,
    checkpoints: Path | None = None,
) -> Identified:
    """Train one model kind with the hyper-parameters selected for it, and judge it on rows that it did not learn from.

    Args:
        rows: What is learned from and what is judged on, as `split_by_purpose` gives them.
        machine: Joints, limits, rate, and the scale of errors.
        parameterization: mlp or kan.
        target: dq or dqdot.
        settings: Section `identify` of a profile.
        progress: Called after each epoch with (epoch from 1, mean training loss, L|eval).
        checkpoints: Folder from which a killed training goes on; None: it does not.

    Raises:
        InputError: Nothing is selected for the kind, the rows are too few, or those to judge on were learned from.
        TrainingDivergedError: L|eval is never finite.
    """
    training = settings.training_of(f"{parameterization.value}_{target.value}")
    if rows.judged_on != VALIDATION:
        check_unseen(rows.learning, rows.judged)
    result = fit(
        rows.learning,
        machine,
        parameterization,
        target,
        training,
        settings,
        settings.seed,
        progress,
        checkpoints,
    )
    predictor = LearnedPredictor(result.model, result.parameters)
    arx = fit_arx(rows.learning, target, training.lags, machine.dt_s, settings.arx_ridge)
    arx = replace(arx, limits=(machine.lower, machine.upper))  # as the model's predictions
    lineage = {
        "judged_on": rows.judged_on,
        "trajectories": [trajectory.name for trajectory in rows.learning],
        "machine": machine.name,
    }
    metrics = result.metrics | judge({"model": predictor, "arx": arx}, rows.judged, machine)
    if isinstance(result.model, FirModel) and rows.judged_on != VALIDATION:
        try:
            band = PredictiveBand(result.model, result.parameters, rows.learning)
            metrics |= _band_metrics(band.coverage(rows.judged), machine)
        except InputError as error:  # the model is as good without
            lineage["band"] = f"not measured: {error}"
    return Identified(
        result.model,
        result.parameters,
        result.curves,
        metrics,
        lineage,
        long_prediction(predictor, rows.judged, FIRST_JUDGED_ROW, settings.long_prediction_steps),
    )


def _band_metrics(coverage: Coverage, machine: MachineSpecification) -> dict[str, Any]:
    """By steps ahead and joint: the share within the 90 % band, and its mean width."""
    metrics: dict[str, Any] = {}
    for steps in BAND_STEPS:
        for name, values in coverage._asdict().items():
            joints = zip(machine.joint_names, values[steps - 1].tolist(), strict=True)
            metrics[f"band_{name}_after_{steps}_steps"] = dict(joints)
    return metrics
