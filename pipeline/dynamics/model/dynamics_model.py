"""The learned dynamics model with its fast rollouts; `StepwiseModel` is the definition that they are equal to."""

from collections.abc import Callable

import jax

from pipeline.dynamics.model.features import History
from pipeline.dynamics.model.network import Parameterization, Parameters
from pipeline.dynamics.model.rollouts.held_command import hold
from pipeline.dynamics.model.rollouts.held_rollout import HeldRollout
from pipeline.dynamics.model.rollouts.open_loop import rollout
from pipeline.dynamics.model.specification import ModelSpecification, Target
from pipeline.dynamics.model.stepwise_model import StepwiseModel
from pipeline.dynamics.model.stops import Stops

__all__ = ["DynamicsModel", "ModelSpecification", "Parameterization", "Target"]


class DynamicsModel(StepwiseModel):
    """f_θ, rolled out by sums over its window. A model that steps in another way subclasses `StepwiseModel` instead."""

    hold = hold
    roll_out = rollout

    def held_rollout(
        self, parameters: Parameters, n_steps: int, stops: Stops | None = None
    ) -> Callable[[History, jax.Array], jax.Array]:
        """See `Dynamics.held_rollout`."""
        return HeldRollout(self, parameters, n_steps, stops)
