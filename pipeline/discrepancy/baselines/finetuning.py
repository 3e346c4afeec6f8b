"""Baseline: the whole network fine-tuned on the measured rows."""

from collections.abc import Sequence

from pipeline.discrepancy.baselines.continued_training import BaselinesConfig, continue_training
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


def fine_tune(
    model: DynamicsModel,
    parameters: Parameters,
    trajectories: Sequence[Trajectory],
    machine: MachineSpecification,
    settings: BaselinesConfig,
    seed: int,
) -> Parameters:
    """θ after training went on on measured rows; arguments and errors as of `continue_training`.

    Every weight may move, so this says how much of the error the data at hand can remove at all, at the price
    of what the network knew of regions that they do not visit.
    """
    return continue_training(model, parameters, trajectories, machine, settings, seed)
