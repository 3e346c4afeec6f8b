"""Effects that the given model has already: whether a run can begin with them."""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.acceptance.held_out_errors import window_errors
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.evaluation.errors import OPEN_LOOP_HORIZON
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.store import ActiveEffects, predictor
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory, validation_part

CHANCE = 0.025  # that the true reduction is smaller than the one that is asked for


def refuse_given(
    given: ActiveEffects,
    model: tuple[DynamicsModel, Parameters],
    nominal: Sequence[Trajectory],
    joints: Sequence[str],
    config: CloseLoopConfig,
) -> None:
    """Refuse effects that cannot be a prior: the nominal logs have them themselves.

    Args:
        model: The frozen model and θ.
        nominal: Logs that are said to be of the machine without them; none are asked where it is given.
        joints: Names.
        config: Section `close_loop`.

    Raises:
        InputError: The effects make the model's error over 4 s on nominal logs smaller, by as much as an effect has to
            that is named.
    """
    if not nominal:
        return
    parts = [validation_part(trajectory) for trajectory in nominal]
    allowed = [np.ones(len(part), bool) for part in parts]
    without, beside = (
        window_errors(predictor(*model, effects), parts, allowed, OPEN_LOOP_HORIZON)
        for effects in (None, given)
    )
    if not len(without.squares):
        return
    least = np.quantile(beside.improvement(without), CHANCE, axis=0)
    shown = [
        name for name, of in zip(joints, least, strict=True) if of > config.gate.smallest_error_reduction
    ]
    if shown:
        raise InputError(
            f"the nominal logs show the effects that the model has already (on {', '.join(shown)}); "
            "name logs of the machine as it was before them, or that model without effects"
        )
