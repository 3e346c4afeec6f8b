"""What else could be done with the same measured rows: fine-tuning, a black-box residual, a wrong effect.

The trained ones see the rows for fitting and select on those for selection, as the search does.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.baselines.continued_training import BaselinesConfig, continue_training
from pipeline.discrepancy.baselines.residual_network import fit_residual_network
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.families.plausibility import is_dependence
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.dynamics.evaluation.errors import Predictor
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.dynamics.model.predictor import LearnedPredictor
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def trained_baselines(
    model: DynamicsModel,
    parameters: Parameters,
    measured: Sequence[Trajectory],
    purposes: Sequence[np.ndarray],
    machine: MachineSpecification,
    config: BaselinesConfig,
    seed: int,
) -> dict[str, Predictor]:
    """`finetune` and `blackbox_residual`.

    Args:
        model: The frozen model f_θ.
        parameters: θ.
        measured: Logs of the machine as it is.
        purposes: Per log (T,) of `splits.Purpose`.
        config: Budget.
        seed: Of initialisation and batches.
    """
    stretches = list(_stretches(measured, purposes))
    arguments = (model, parameters, stretches, machine, config, seed)
    return {
        "finetune": LearnedPredictor(model, continue_training(*arguments)),
        "blackbox_residual": fit_residual_network(*arguments),
    }


def _stretches(measured: Sequence[Trajectory], purposes: Sequence[np.ndarray]) -> Iterator[Trajectory]:
    """Stretches of rows for fitting and for selection, as trajectories that mark the latter as validation."""
    for trajectory, purpose in zip(measured, purposes, strict=True):
        edges = [0, *(np.flatnonzero(np.diff(purpose)) + 1).tolist(), len(purpose)]
        for begin, end in itertools.pairwise(edges):
            if purpose[begin] in (Purpose.fit, Purpose.select):
                rows = {
                    name: getattr(trajectory, name)[begin:end] for name in ("t_s", "stamp_ns", "q", "qd", "a")
                }
                is_validation = np.full(end - begin, purpose[begin] == Purpose.select)
                yield replace(trajectory, **rows, is_validation=is_validation)


def wrong_effect(effects: Sequence[MachineEffect], screened: Sequence[Candidate]) -> MachineEffect | None:
    """A middling fit of another family than was found, on the same joint.

    Args:
        effects: That were found, strongest first.
        screened: Candidates of the first screen.
    """
    if not effects or not effects[0].has_wrapper:
        return None
    first = effects[0].members[0].candidate
    others = [
        c
        for c in screened
        if c.joint == first.joint
        and c.family != first.family
        and has_wrapper(c)
        and not is_dependence(c)
        and c.gain > 0
    ]
    if not others:
        return None
    middling = sorted(others, key=lambda c: -c.gain)[len(others) // 2]
    return MachineEffect(middling.family, [SelectedEffect(middling)])
