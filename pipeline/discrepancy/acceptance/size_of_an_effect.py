"""Effects that are no larger than what nominal logs ask for, which are without them: the diagnosis model's misfit.

A small change that many rows show is beyond chance, and beyond every placebo, where it is but that misfit.
Of a supply not its size tells, but on how many joints and for how long its change of speed is the same.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t

from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS, nominal_parts, without_onsets
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour
from pipeline.discrepancy.families.supply_variation import SHORTEST_S
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of

# 95 % of sizes about zero are within so many times their root mean square over so few parts.
LARGEST_BY_CHANCE = float(t.ppf(0.975, MISFIT_PARTS))


class Asked(NamedTuple):
    """What logs that are without an effect ask for, by least squares.

    Attributes:
        share: Of the effect's size; root mean square over parts of the logs.
        squares: Of what the effect changes, in units of the noise floor's: mean over the parts.
    """

    share: float
    squares: float


def asked_for(change: np.ndarray, residual: np.ndarray, floor: np.ndarray) -> Asked:
    """Of an effect of size one.

    Args:
        change: (N, k) by the effect.
        residual: (N, k) without it.
        floor: (k,) mean squares of the noise.
    """
    # Curvature of all rows, not of the part: a part that hardly shows the effect says little, not anything.
    squares = float(np.sum(change**2 / floor)) / MISFIT_PARTS
    asked = np.bincount(nominal_parts(len(residual)), np.sum(change * residual / floor, axis=1), MISFIT_PARTS)
    return Asked(float(np.sqrt(np.mean((asked / max(squares, 1e-12)) ** 2))), squares)


def asked_for_on_nominal(nominal: NominalBehaviour, members: Sequence[SelectedEffect]) -> Asked:
    """Of an effect, joint by joint, with the values that measured logs gave it.

    It would be zero, were the diagnosis model right. Where it is not, measured logs that visit the same places more
    often show more of the same misfit, but none of another size.
    """
    residual = residual_of(nominal.simulation, nominal.rows, [])
    change = residual - residual_of(nominal.simulation, nominal.rows, without_onsets(members))
    return asked_for(change, residual, nominal.rows.floor)


def to_put_on_nominal(diagnosis: Diagnosis, effect: MachineEffect) -> list[SelectedEffect]:
    """An effect joint by joint, where nominal logs are without it; empty where nothing can be asked of them.

    Of what has no equation nothing can be put on nominal logs; of what stops showed, they say nothing.
    """
    if effect.family in diagnosis.nominal.present or diagnosis.logs.is_of_one_machine:
        return []
    return [m for m in effect.members if has_wrapper(m.candidate) and m.candidate.deviation is None]


def why_it_is_misfit(share: float) -> str | None:
    """A clause where an effect's size is within 95 % of what nominal logs ask for; None: it is beyond that."""
    if LARGEST_BY_CHANCE * share < 1.0:
        return None
    return f"nominal logs, which are without it, ask for {share:.0%} of its size"


def why_it_is_no_supply(correlation_time: Mapping[str, Any], n_joints: int) -> str | None:
    """A clause where a common change of speed is none; None: it is one.

    A supply changes the speed of every joint, and for longer than the model is off alike where joints start and stop
    together.
    """
    if n_joints < 2:
        return "all joints have a supply in common, and one alone shows this"
    if correlation_time["value"] >= SHORTEST_S:
        return None
    told = f"{correlation_time['value']:.2g} {correlation_time['unit']}"
    return f"a correlation_time of {told} is that of joints which start and stop together"
