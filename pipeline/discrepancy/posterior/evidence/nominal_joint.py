"""What nominal logs say of one joint's residual: noise, common misfit, and what varies from session to session."""

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.posterior.evidence.products import NO_COEFFICIENTS
from pipeline.discrepancy.posterior.evidence.robust_evidence import Block, fit
from pipeline.discrepancy.posterior.residual.columns import Columns, Term
from pipeline.discrepancy.posterior.residual.noise import Noise, has_past, learn_noise
from pipeline.discrepancy.posterior.residual.repeatability import (
    Basis,
    basis_of,
    common_misfit,
    learn_sizes,
    less_misfit,
)
from pipeline.discrepancy.posterior.residual.rows import RowFacts
from pipeline.discrepancy.posterior.residual.speed_in_time import (
    USUAL_DEVIATION,
    USUAL_TIME_S,
    cosines,
    deviations,
)

LEAST_SHARES = (0.05, 0.15, 0.5, 1.5)  # τ: of the floor's squares
PART_ROWS = 3600  # of a nominal part: six minutes


class Rows(NamedTuple):
    """Columns on one set of logs, with what is known of their rows.

    Attributes:
        columns: Of all joints.
        facts: Of the rows.
        velocity: (N, n_joint) predicted without effects.
        weight: (N, n_joint) 0 where a joint does not count.
        spread: (N, n_joint, n_members) how far each member of the model is from the model; 0 on nominal rows, which
            some members were trained on.
    """

    columns: Columns
    facts: RowFacts
    velocity: np.ndarray
    weight: np.ndarray
    spread: np.ndarray

    def speed(self, joint: int) -> np.ndarray:
        """(N,) velocity where the joint counts, 0 elsewhere."""
        return np.asarray(self.weight[:, joint] * self.velocity[:, joint])


class NominalJoint(NamedTuple):
    """What nominal logs say of one joint's residual.

    Attributes:
        noise: Of its rows.
        basis: What varies from session to session.
        misfit: (K,) coefficients of `basis` that all sessions have in common.
        variance: (K,) of the coefficients of `basis`, from session to session.
        of_floor: (K,) variances with which all families make up the squares of the residual.
        evidence: Per value of τ, log, of the nominal parts themselves; over that of the least τ.
    """

    noise: Noise
    basis: Basis
    misfit: np.ndarray
    variance: np.ndarray
    of_floor: np.ndarray
    evidence: Mapping[float, float]


def learn_joint(
    joint: int, nominal: Rows, terms: Sequence[Term], length_s: float, present: Collection[str]
) -> NominalJoint:
    """Learn noise, misfit and repeatability.

    Args:
        joint: Index.
        nominal: Rows that the members of the model did not see.
        terms: Of the joint.
        length_s: Mean length of the measured sessions.
        present: Families of effects that nominal logs show themselves.
    """
    residual, facts = nominal.columns.residual[:, joint], nominal.facts
    state, velocity = facts.state[:, joint], nominal.speed(joint)
    counts = nominal.weight[:, joint] > 0.0
    noise = learn_noise(residual, state, facts.run, counts, velocity)
    part = _parts(facts.session)
    raw, _ = raw_columns(joint, nominal, part)
    matrix = noise.whiten(raw.astype(np.float32), state, facts.run, velocity)
    speed = np.arange(nominal.columns.matrices[joint].shape[1] + nominal.spread.shape[2], matrix.shape[1] - 1)
    basis = basis_of(terms, speed, deviations(length_s, USUAL_TIME_S, USUAL_DEVIATION))
    scaled = np.column_stack([matrix[:, basis.columns] * basis.scale, matrix[:, -1]])
    told = has_past(facts.run) & counts
    parts = [scaled[(part == number) & told] for number in np.unique(part)]
    # What nominal logs show themselves is neither misfit nor scatter: it is what the model lacks.
    is_scatter = np.array([family not in present for family in basis.families])
    misfit, of_others, variance = _misfit_and_variance(
        parts, _sessions_of(part, facts.session), basis.families, is_scatter
    )
    variance = variance * basis.scale**2
    floor = max(float(np.mean(residual[counts] ** 2)) if counts.any() else 0.0, 1e-18)
    of_floor = share_of_squares(raw[counts][:, basis.columns], basis.families, floor)
    evidence = {
        least: _evidence(parts, of_others, noise, np.sqrt(variance + least * of_floor) / basis.scale)
        for least in LEAST_SHARES
    }
    known = {least: of - evidence[LEAST_SHARES[0]] for least, of in evidence.items()}
    return NominalJoint(noise, basis, basis.scale * misfit, variance, of_floor, known)


def raw_columns(joint: int, rows: Rows, part: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, M + 1) columns, slow variations of speed over each part, and the residual; and a part's mean length, s."""
    over_time, length_s = cosines(rows.facts.stamp_ns, part)
    speed = rows.speed(joint)[:, None]
    both = [
        rows.columns.matrices[joint],
        rows.spread[:, joint],
        speed * over_time,
        rows.columns.residual[:, joint, None],
    ]
    return np.column_stack(both), length_s


def share_of_squares(columns: np.ndarray, families: Sequence[str], square: float) -> np.ndarray:
    """(K,) variances of coefficients with which all families make up a mean square, each as much as any other.

    Args:
        columns: (N, K).
        families: (K,).
        square: The mean square.
    """
    squares = np.sum(columns**2, axis=0, dtype=float) / max(len(columns), 1)
    members = np.array([families.count(family) for family in families])
    return np.asarray(square / (np.maximum(squares, 1e-6 * square) * members * len(set(families))))


def _misfit_and_variance(
    parts: Sequence[np.ndarray], sessions: np.ndarray, families: Sequence[str], is_scatter: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Common misfit (K,), per part that of the other sessions, and variance (K,) of what they leave.

    A part's own session is left out: what a session has of its own, its parts have in common.
    """
    grams, n_rows = [rows.T @ rows for rows in parts], [len(rows) for rows in parts]
    of_all = np.sum(grams, axis=0)

    def sizes(of: Sequence[np.ndarray], n: Sequence[int]) -> np.ndarray:
        learned = learn_sizes(of, n, families)
        return is_scatter * np.array([learned[family] for family in families])

    in_common = sizes([of_all], [sum(n_rows)])
    own = {
        session: np.sum([gram for gram, of in zip(grams, sessions, strict=True) if of == session], axis=0)
        for session in set(sessions.tolist())
    }
    of_others = [common_misfit(of_all - own[session], in_common) for session in sessions.tolist()]
    left = [less_misfit(gram, misfit) for gram, misfit in zip(grams, of_others, strict=True)]
    return common_misfit(of_all, in_common), of_others, sizes(left, n_rows)


def _evidence(
    parts: Sequence[np.ndarray], misfits: Sequence[np.ndarray], noise: Noise, deviation: np.ndarray
) -> float:
    """Log evidence of nominal parts, each without the misfit of the others; deviation (K,) of scaled columns."""
    of = deviation.astype(np.float32)
    blocks = [
        Block(
            np.zeros((len(rows), 0)),
            rows[:, :-1] * of,
            rows[:, -1] - rows[:, :-1] @ misfit,
            noise.degrees,
            noise.scale,
        )
        for rows, misfit in zip(parts, misfits, strict=True)
    ]
    return fit(blocks, NO_COEFFICIENTS, 1.0).evidence


def _sessions_of(part: np.ndarray, session: np.ndarray) -> np.ndarray:
    """Of each part (in order) the session; of a single session each part its own."""
    first = np.unique(part, return_index=True)[1]
    return session[first] if len(np.unique(session)) > 1 else part[first]


def _parts(session: np.ndarray) -> np.ndarray:
    """(N,) numbers of parts of about six minutes, of one session each."""
    part, n = np.zeros(len(session), int), 0
    for number in np.unique(session):
        for rows in np.array_split(
            np.flatnonzero(session == number), max(1, round(np.sum(session == number) / PART_ROWS))
        ):
            part[rows] = n
            n += 1
    return part
