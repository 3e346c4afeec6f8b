"""Evidence of speed that varies in time without a cause that is measured: of all joints in common, or of one joint.

Each is a Gaussian process of one of some correlation times and deviations (`speed_in_time.py`).
"""

from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence, Scatter
from pipeline.discrepancy.posterior.evidence.products import Prior
from pipeline.discrepancy.posterior.evidence.robust_evidence import Block, fit
from pipeline.discrepancy.posterior.residual.speed_in_time import DEVIATIONS, N_COSINE, TIMES_S, deviations

PROCESSES = tuple((time_s, deviation) for time_s in TIMES_S for deviation in DEVIATIONS)


def evidence_of_processes(joints: Sequence[JointEvidence], on: Sequence[int]) -> np.ndarray:
    """(n_process,) log evidence of each process on joints, but for what the others' rows say.

    Args:
        joints: All of the machine.
        on: One joint, or all of them: these vary in common then.
    """
    if len(on) == 1:
        return np.array([joints[on[0]].fit((), speed=process).evidence for process in PROCESSES])
    blocks = [block for joint in on for block in _with_common_speed(joints[joint])]
    return np.array([_in_common(blocks, joints[on[0]].length_s, *process) for process in PROCESSES])


def _with_common_speed(joint: JointEvidence) -> list[Block]:
    """A joint's sessions, with slow variations of speed as effects that joints have in common."""
    of_session = joint.speed_columns()
    blocks = []
    for number, (block, speed) in enumerate(
        zip(joint.blocks((), Scatter(joint.least())), of_session, strict=True)
    ):
        effects = np.zeros((len(speed), len(of_session) * N_COSINE))
        effects[:, number * N_COSINE : (number + 1) * N_COSINE] = speed
        blocks.append(block._replace(effects=effects))
    return blocks


def _in_common(blocks: Sequence[Block], length_s: float, time_s: float, deviation: float) -> float:
    """Log evidence of a common variation of speed."""
    n = blocks[0].effects.shape[1]
    of_sessions = np.tile(deviations(length_s, time_s, deviation) ** -2, n // N_COSINE)
    free = np.full(n, np.inf)
    return fit(blocks, Prior(np.zeros(0, int), np.zeros(n), of_sessions, -free, free)).evidence
