"""Sizes that are none: what the nominal logs show as well, though no effect is there.

A small change that many rows show is beyond chance, and beyond every placebo, where it is but the model's own misfit.
Of a supply it is not its size that tells, but on how many joints and for how long its change of speed is the same.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pipeline.discrepancy.acceptance.parameter_misfit import MISFIT_PARTS, on_nominal_parts
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.supply_variation import SHORTEST_S
from pipeline.discrepancy.selection.selected_effect import SelectedEffect, residual_of
from pipeline.effects.draws import OF_95_PERCENT


def share_on_nominal(simulation: Simulation, rows: ScoredRows, members: Sequence[SelectedEffect]) -> float:
    """Share of an effect's size that nominal logs ask for, by least squares; root mean square over their parts.

    It would be zero, were the diagnosis model right: the logs are without the effect. Where it is not, measured logs
    that visit the same places more often show more of the same misfit, but none of another size.

    Args:
        simulation: On nominal logs, by members that did not see them.
        rows: Of the nominal logs.
        members: The effect, joint by joint, with the values that measured logs gave it.
    """
    residual = residual_of(simulation, rows, [])
    everywhere, part = on_nominal_parts(members, len(residual))
    change = residual - residual_of(simulation, rows, everywhere)
    # Curvature of all rows, not of the part: a part that hardly shows the effect says little, not anything.
    squares = np.sum(change**2 / rows.floor) / MISFIT_PARTS
    asked = np.bincount(part, np.sum(change * residual / rows.floor, axis=1), MISFIT_PARTS)
    return float(np.sqrt(np.mean((asked / max(squares, 1e-12)) ** 2)))


def why_it_is_misfit(share: float) -> str | None:
    """A clause where an effect's size is within 95 % of what nominal logs ask for; None: it is beyond that."""
    if OF_95_PERCENT * share < 1.0:
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
