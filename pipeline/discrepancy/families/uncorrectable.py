"""Effects without a wrapper: they are seen, tested and named, but nothing says what they will do next."""

from collections.abc import Collection
from types import MappingProxyType

from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows
from pipeline.discrepancy.diagnosis.simulation import Hypothesis, Simulation
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import supply_candidates
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.time_varying_gain import course_candidates
from pipeline.discrepancy.selection.candidate import Candidate, Nominal
from pipeline.effects.catalogue import KNOWN
from pipeline.errors import InputError

TRIED = {SUPPLY: supply_candidates, COURSE: course_candidates}
WITHOUT_WRAPPER = tuple(TRIED)


def has_wrapper(candidate: Candidate) -> bool:
    """Whether there is something to put into the model."""
    return candidate.family not in WITHOUT_WRAPPER


def screen_without_wrapper(
    simulation: Simulation,
    active: Hypothesis,
    rows: ScoredRows,
    excluded: Collection[str],
    nominal: Nominal = MappingProxyType({}),
) -> list[Candidate]:
    """One candidate per joint of each such family; arguments as of `screen`."""
    tried = [candidates for family, candidates in TRIED.items() if family not in excluded]
    return [one for candidates in tried for one in candidates(simulation, active, rows, nominal)]


def refuse_unknown(excluded: Collection[str]) -> None:
    """Check families that are not to be tried.

    Raises:
        InputError: One of them is not tried anyway.
    """
    known = [*KNOWN, *WITHOUT_WRAPPER]
    for family in excluded:
        if family not in known:
            raise InputError(
                f"close_loop.exclude has {family}, which is not tried anyway; choose from {', '.join(known)}"
            )
