"""What each candidate gains on nominal logs, where there is nothing to be found but the diagnosis model's misfit."""

from collections.abc import Sequence

from pipeline.discrepancy.plausibility import THERMAL_DRIFT, is_plausible
from pipeline.discrepancy.regression import t_statistic
from pipeline.discrepancy.screen import Rows, screen
from pipeline.discrepancy.simulation import Simulation
from pipeline.discrepancy.supply_variation import supply_candidates

PRESENT_SHARE, PRESENT_T = 0.1, 2.5  # of an effect that the nominal logs have, too


def null_gains(
    simulation: Simulation, rows: Rows, excluded: Sequence[str]
) -> dict[tuple[str, int, int | None], float]:
    """Gain per used row that each candidate has on nominal logs."""
    candidates = screen(simulation, {}, rows, excluded) + supply_candidates(simulation, {}, rows)
    n = len(rows.folds.fold)
    gains = {c.key: max(0.0, c.gain) / n for c in candidates}
    warming = [
        c
        for c in candidates
        if c.family == THERMAL_DRIFT and c.share > PRESENT_SHARE and t_statistic(c.gain_by_block) > PRESENT_T
    ]
    if len(warming) > 1 and is_plausible(THERMAL_DRIFT, warming):
        # Nominal logs that show it themselves are no evidence against it: the model, whose memory is short, lacks it.
        gains |= {key: 0.0 for key in gains if key[0] == THERMAL_DRIFT}
    return gains
