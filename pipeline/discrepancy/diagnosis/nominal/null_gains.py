"""What explains something of nominal logs, where there is nothing to be found but the diagnosis model's misfit."""

from collections.abc import Sequence
from typing import NamedTuple

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.families.plausibility import THERMAL_DRIFT, is_plausible
from pipeline.discrepancy.families.uncorrectable import screen_without_wrapper
from pipeline.discrepancy.selection.candidate import Misfit, Nominal
from pipeline.discrepancy.selection.regression import SURE_T, t_statistic
from pipeline.discrepancy.selection.screen import screen

PRESENT_SHARE = 0.05  # of an effect that the nominal logs have, too


class Null(NamedTuple):
    """What nominal logs show.

    Attributes:
        misfits: Candidates that the diagnosis model's misfit makes gain.
        present: Families of effects that are there.
    """

    misfits: Nominal
    present: tuple[str, ...]


def null_gains(simulation: Simulation, rows: ScoredRows, excluded: Sequence[str], factor: float) -> Null:
    """The candidates that gain on rows of nominal logs that their values were not fitted to.

    Args:
        simulation: On nominal logs, by members that did not see them.
        rows: Their rows.
        excluded: Families that are not tried.
        factor: How many times its gain per row a candidate owes at most: misfit differs from log to log.
    """
    candidates = [
        *screen(simulation, NOMINAL, rows, excluded),
        *screen_without_wrapper(simulation, NOMINAL, rows, excluded),
    ]
    n = len(rows.folds.fold)
    misfits = {c.key: Misfit(c, factor * c.gain / n) for c in candidates if c.gain > 0.0}
    warming = [
        c
        for c in candidates
        if c.family == THERMAL_DRIFT and c.share > PRESENT_SHARE and t_statistic(c.gain_by_block) > SURE_T
    ]
    if len(warming) > 1 and is_plausible(THERMAL_DRIFT, warming):
        # Nominal logs that show it themselves are no evidence against it: the model, whose memory is short, lacks it.
        misfits = {key: misfit for key, misfit in misfits.items() if key[0] != THERMAL_DRIFT}
        return Null(misfits, (THERMAL_DRIFT,))
    return Null(misfits, ())
