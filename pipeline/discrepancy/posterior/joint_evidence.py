"""All that the logs say of one joint: its columns, noise and nuisance, and the evidence of any set of terms."""

from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from pipeline.discrepancy.posterior.columns import Columns, Term
from pipeline.discrepancy.posterior.gram import NO_COEFFICIENTS, Prior, given, without_nuisance
from pipeline.discrepancy.posterior.noise import has_past, learn_noise
from pipeline.discrepancy.posterior.repeatability import basis_of, learn_sizes
from pipeline.discrepancy.posterior.robust_evidence import Block, Fit, fit
from pipeline.discrepancy.posterior.rows import RowFacts
from pipeline.discrepancy.posterior.speed_in_time import (
    USUAL_DEVIATION,
    USUAL_TIME_S,
    cosines,
    deviations,
)
from pipeline.discrepancy.posterior.term_evidence import term_evidence

LEAST_SHARES = (0.05, 0.15, 0.5, 1.5)  # of the floor's squares
PART_ROWS = 3600  # of a nominal part: six minutes
SESSION_EDGE_S, ONSET_STEP_S = 20.0, 10.0
MOST_MOMENTS = 120  # over all logs: of longer ones the moments are further apart
Group = tuple[str, int | None, bool]  # family, source, and whether it sets in


class Rows(NamedTuple):
    """Columns on one set of logs, with what is known of their rows.

    Attributes:
        columns: Of all joints.
        facts: Of the rows.
        velocity: (N, n_joint) predicted without effects.
        weight: (N, n_joint) 0 where a joint does not count.
    """

    columns: Columns
    facts: RowFacts
    velocity: np.ndarray
    weight: np.ndarray


class Found(NamedTuple):
    """A group of terms: one family on one joint, with or without an onset.

    Attributes:
        evidence: Log Bayes factor over none, the mean over its terms.
        best: Index of its most probable term.
    """

    evidence: float
    best: int


class JointEvidence:
    """Of one joint; what was computed once is kept."""

    def __init__(self, joint: int, nominal: Rows, measured: Rows, present: Collection[str] = ()) -> None:
        """Learn noise and repeatability from nominal rows, and prepare the measured ones.

        Args:
            joint: Index.
            nominal: Rows that the members of the model did not see.
            measured: Rows in question.
            present: Families of effects that nominal logs show themselves.
        """
        self.joint = joint
        self.terms: list[Term] = [term for term in measured.columns.terms if term.joint == joint]
        self.onsets: list[int | None] = [None] * len(self.terms)
        state = nominal.facts.state[:, joint]
        counts = nominal.weight[:, joint] > 0.0
        self.noise = learn_noise(nominal.columns.residual[:, joint], state, nominal.facts.run, counts)
        part = _parts(nominal.facts.session)
        matrix = self._whiten(self._raw(nominal, part)[0], nominal)
        n_column = nominal.columns.matrices[joint].shape[1]
        self._measured, self._session = measured, measured.facts.session
        raw, self.length_s = self._raw(measured, self._session)
        self.matrix = self._whiten(raw, measured)
        self.speed = np.arange(n_column, self.matrix.shape[1] - 1)
        self.basis = basis_of(
            self.terms, self.speed, deviations(self.length_s, USUAL_TIME_S, USUAL_DEVIATION)
        )
        scaled = np.column_stack([matrix[:, self.basis.columns] * self.basis.scale, matrix[:, -1]])
        of_part = [scaled[part == number] for number in np.unique(part)]
        sizes = learn_sizes(
            [rows.T @ rows for rows in of_part], [len(rows) for rows in of_part], self.basis.families
        )
        # What nominal logs show themselves is no scatter: it is what the model lacks.
        of_scatter = {family: 0.0 if family in present else size for family, size in sizes.items()}
        self.nominal_variance = np.array([of_scatter[family] for family in self.basis.families])
        is_counted = measured.weight[:, joint] > 0.0
        self._of_floor = self._share_of_floor(
            nominal.columns.residual[counts, joint], raw[is_counted][:, self.basis.columns]
        )
        self._is_told = has_past(measured.facts.run) & is_counted
        self._forget()

    def _raw(self, rows: Rows, part: np.ndarray) -> tuple[np.ndarray, float]:
        """(N, M + 1) columns, slow variations of speed, and the residual; and the length of a part."""
        joint = self.joint
        over_time, length_s = cosines(rows.facts.stamp_ns, part)
        speed = (rows.weight[:, joint] * rows.velocity[:, joint])[:, None]
        both = [rows.columns.matrices[joint], speed * over_time, rows.columns.residual[:, joint, None]]
        return np.column_stack(both), length_s

    def _whiten(self, values: np.ndarray, rows: Rows) -> np.ndarray:
        return self.noise.whiten(values.astype(np.float32), rows.facts.state[:, self.joint], rows.facts.run)

    def _share_of_floor(self, residual: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """(K,) variances with which the nuisance of all families makes up the squares of the nominal residual.

        Args:
            residual: Of the nominal rows that count.
            columns: (N, K) of the nuisance on measured rows that count.
        """
        floor = max(float(np.mean(residual**2)) if len(residual) else 0.0, 1e-18)
        squares = np.sum(columns**2, axis=0, dtype=float) / max(len(columns), 1)
        families = list(self.basis.families)
        members = np.array([families.count(family) for family in families])
        return np.asarray(floor / (np.maximum(squares, 1e-6 * floor) * members * len(set(families))))

    def _forget(self) -> None:
        self._groups: dict[tuple[int, ...], tuple[dict[Group, Found], np.ndarray]] = {}
        self._fits: dict[tuple, tuple[float, Fit]] = {}

    def _sessions(self) -> list[np.ndarray]:
        """Per session the rows that tell, (N,) bool."""
        return [self._is_told & (self._session == number) for number in np.unique(self._session)]

    def let_set_in(self, families: Sequence[str]) -> None:
        """Add terms that set in at some moment: of each family the most probable one."""
        groups, _ = self.groups(())
        stamp_ns = self._measured.facts.stamp_ns
        edge, step = int(SESSION_EDGE_S * 1e9), int(ONSET_STEP_S * 1e9)
        sessions = [of for of in self._sessions() if of.any()]
        ends = [(stamp_ns[of].min() + edge, stamp_ns[of].max() - edge) for of in sessions]
        step = max(step, sum(last - first for first, last in ends) // MOST_MOMENTS)
        moments = [moment for first, last in ends for moment in np.arange(first, last, step).tolist()]
        added: list[np.ndarray] = []
        first = self.matrix.shape[1] - 1
        for family in families:
            found = groups.get((family, None, False))
            if found is None:
                continue
            term = self.terms[found.best]
            of_term = self._measured.columns.matrices[self.joint][:, list(term.columns)]
            for moment in moments:
                columns = tuple(range(first + len(added), first + len(added) + len(term.columns)))
                added += list((of_term * (stamp_ns >= moment)[:, None]).T)
                self.terms.append(term._replace(columns=columns))
                self.onsets.append(int(moment))
        if added:
            whitened = self._whiten(np.stack(added, axis=1), self._measured)
            self.matrix = np.column_stack([self.matrix[:, :-1], whitened, self.matrix[:, -1]])
            self._forget()

    def prior(self, terms: Sequence[int]) -> Prior:
        """Of the coefficients of terms, by index; a column that two share is in it once."""
        values: dict[int, tuple[float, ...]] = {}
        for index in terms:
            term = self.terms[index]
            rows = zip(term.columns, term.mean, term.scale, term.lower, term.upper, strict=True)
            values.update({column: (mean, scale**-2, *bounds) for column, mean, scale, *bounds in rows})
        if not values:
            return NO_COEFFICIENTS
        return Prior(np.array(list(values)), *np.array(list(values.values())).T)

    def groups(self, beside: Sequence[int]) -> tuple[dict[Group, Found], np.ndarray]:
        """Every group of terms beside given ones, and (n_terms,) log Bayes factors.

        The noise is normal here, with the weights of rows that the given terms leave.
        """
        key = tuple(sorted(beside))
        if key not in self._groups:
            least, fitted = self._least(key)
            total = np.zeros((self.matrix.shape[1],) * 2)
            for session, weight in zip(self._sessions(), fitted.weights, strict=True):
                rows = self.matrix[session] * np.sqrt(weight)[:, None].astype(np.float32)
                total += without_nuisance(
                    (rows.T @ rows).astype(float), self.basis.columns, self._variance(least)
                )
            gram, _ = given(total, self.prior(key))
            evidence = term_evidence(gram, self.terms)
            members: dict[Group, list[int]] = defaultdict(list)
            for index, (term, onset) in enumerate(zip(self.terms, self.onsets, strict=True)):
                members[term.family, term.source, onset is not None].append(index)
            found = {
                group: Found(
                    float(logsumexp(evidence[indices]) - np.log(self.n_alternatives(indices[0]))),
                    indices[int(np.argmax(evidence[indices]))],
                )
                for group, indices in members.items()
            }
            self._groups[key] = found, evidence
        return self._groups[key]

    def _variance(self, least: float) -> np.ndarray:
        """(K,) of the nuisance's coefficients."""
        return self.nominal_variance * self.basis.scale**2 + least * self._of_floor

    def n_alternatives(self, index: int) -> int:
        """How many terms stand for the cause of a term, each as probable before any row is seen.

        Of what sets in, each moment with each term of what does not.
        """
        alike = self._alike(index)
        n = sum(self.onsets[other] is None for other in alike)
        return n if self.onsets[index] is None else n * (len(alike) - n)

    def n_points(self, index: int) -> int:
        """How many grid points the family of a term has."""
        return len({tuple(sorted(self.terms[other].point.items())) for other in self._alike(index)})

    def _alike(self, index: int) -> list[int]:
        """Terms of the same family and source."""
        key = self.terms[index].family, self.terms[index].source
        return [other for other, term in enumerate(self.terms) if (term.family, term.source) == key]

    def blocks(
        self, terms: Sequence[int], least: float, speed: tuple[float, float] | None = None
    ) -> list[Block]:
        """Rows per session, with the columns of terms.

        Args:
            terms: Indices, whose `prior` the columns are in the order of.
            least: τ.
            speed: Correlation time, s, and deviation of slow variations of speed beside those of nominal logs.
        """
        variance = self._variance(least)
        if speed is not None:
            variance[-len(self.speed) :] += deviations(self.length_s, *speed) ** 2
        columns = self.prior(terms).columns
        return [
            Block(
                self.matrix[session][:, columns],
                self.matrix[session][:, self.basis.columns] * np.sqrt(variance).astype(np.float32),
                self.matrix[session][:, -1],
                self.noise.degrees,
                self.noise.scale,
            )
            for session in self._sessions()
        ]

    def speed_columns(self) -> list[np.ndarray]:
        """Slow variations of speed, whitened, for each of `blocks`."""
        return [self.matrix[session][:, self.speed] for session in self._sessions()]

    def fit(self, terms: Sequence[int], speed: tuple[float, float] | None = None) -> Fit:
        """Terms together, with heavy-tailed noise, at the τ of greatest evidence."""
        return self._least(tuple(sorted(terms)), speed)[1]

    def least(self) -> float:
        """The τ of greatest evidence without any effect."""
        return self._least(())[0]

    def _least(self, terms: tuple[int, ...], speed: tuple[float, float] | None = None) -> tuple[float, Fit]:
        key = terms, speed
        if key not in self._fits:
            prior = self.prior(terms)
            # Beside variations of speed little else varies in time.
            sizes: Sequence[float] = LEAST_SHARES if speed is None else [self.least()]
            for least in sizes:  # upwards, as far as the evidence rises
                fitted = fit(self.blocks(terms, least, speed), prior)
                if key in self._fits and fitted.evidence <= self._fits[key][1].evidence:
                    break
                self._fits[key] = least, fitted
        return self._fits[key]


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
