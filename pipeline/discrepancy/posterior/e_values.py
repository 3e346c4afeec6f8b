"""How far confirmation rows bear out what was named: split likelihood ratios, one per finding.

    e  =  p(r | h, β̂)  /  max_{h'} max_β p(r | h', β)        on confirmation rows

h is the explanation, with coefficients β̂ from the rows for fitting and selection, half of it by its columns and half by
the simulation of its effects. h' is the explanation with another cause, or none, in the place of the finding. If one of
these is true, e exceeds 1/α with probability α at most, whatever was searched. Source: Wasserman, Ramdas and
Balakrishnan (2020), Universal inference, PNAS 117.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from pipeline.discrepancy.posterior.evidence.joint_evidence import JointEvidence
from pipeline.discrepancy.posterior.explanations import Explanation, acts_on_several, are_alike, terms_of
from pipeline.discrepancy.posterior.findings import Finding
from pipeline.discrepancy.posterior.new_rows import log_predictive
from pipeline.discrepancy.selection.grouping import told_as

RIVALS = 8  # families per joint that are fitted with heavy tails: the most probable ones with normal noise
LARGEST_LOGARITHM = 700.0  # of a number that can be held


def e_value_of(logarithm: float) -> float:
    """The e-value of a natural logarithm, as large as can be held."""
    return float(np.exp(min(logarithm, LARGEST_LOGARITHM)))


def log_e_value(
    finding: Finding,
    explanation: Explanation,
    fitted: Sequence[JointEvidence],
    held_out: Sequence[JointEvidence],
    residual: np.ndarray,
) -> float:
    """Natural logarithm of the e-value of one finding.

    Args:
        finding: Of the explanation.
        explanation: In question.
        fitted: Per joint, on the rows that it was found on.
        held_out: Per joint, the same terms on confirmation rows.
        residual: (N, n_joint) on these in the presence of the effects as they were fitted.
    """
    terms, joints = terms_of(explanation.causes), sorted(finding.joints)
    rivals = _best_rival(finding, [(terms.get(joint, ()), held_out[joint]) for joint in joints])
    named = log_predictive(finding.causes[0], terms, fitted, held_out, joints)
    if finding.causes[0].terms:
        of_effects = sum(
            held_out[joint].likelihood_of_residual(residual[:, joint], terms[joint], fitted[joint])
            for joint in joints
        )
        named = float(np.logaddexp(named, of_effects) - np.log(2.0))
    return float(named - rivals)


def _best_rival(finding: Finding, of_joints: Sequence[tuple[tuple[int, ...], JointEvidence]]) -> float:
    """Greatest log likelihood of nothing, or of one other cause, in the place of a finding.

    Args:
        finding: In question.
        of_joints: The explanation's terms on each of its joints, and the joint on confirmation rows.
    """
    without, gains = 0.0, defaultdict(list)
    for terms, joint in of_joints:
        own = {cause.terms.get(joint.joint) for cause in finding.causes}
        beside = tuple(index for index in terms if index not in own)
        nothing = joint.greatest_likelihood(beside)
        without += nothing
        groups, _ = joint.groups(beside)
        others = [g for g in groups if not _is_told_alike(finding, g[:2])]
        for group in sorted(others, key=lambda g: -groups[g].evidence)[:RIVALS]:
            gain = joint.greatest_likelihood((*beside, groups[group].best)) - nothing
            gains[group[0]].append(max(gain, 0.0))
    most = [sum(of) if acts_on_several(family) else max(of) for family, of in gains.items()]
    return without + max(most, default=0.0)


def _is_told_alike(finding: Finding, group: tuple[str, int | None]) -> bool:
    """Whether it would be told by the same name: every dependence is `other`."""
    of_finding = [(cause.family, cause.source) for cause in finding.causes]
    return told_as(group[0]) == finding.family or any(are_alike(of, group) for of in of_finding)
