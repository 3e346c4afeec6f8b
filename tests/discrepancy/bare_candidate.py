"""A candidate of which nothing matters but its family, its joint and where it stands on its grid."""

import numpy as np

from pipeline.discrepancy.selection.candidate import Candidate


def bare_candidate(family: str, joint: int, **point: float) -> Candidate:
    """With some gain in four blocks."""
    return Candidate(family, joint, None, point, (), np.zeros(0), 1.0, 0.5, np.ones(4))
