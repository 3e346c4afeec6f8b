"""Effects without a wrapper: they are seen, tested and named, but nothing says what they will do next."""

from pipeline.discrepancy.course_in_time import FAMILY as COURSE
from pipeline.discrepancy.screen import Candidate
from pipeline.discrepancy.supply_variation import FAMILY as SUPPLY

WITHOUT_WRAPPER = (SUPPLY, COURSE)


def has_wrapper(candidate: Candidate) -> bool:
    """Whether there is something to put into the model."""
    return candidate.family not in WITHOUT_WRAPPER
