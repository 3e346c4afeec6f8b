"""All that the logs say of one joint: its columns, noise and nuisance, and the evidence of any set of terms."""

import copy
from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.posterior.columns import Columns, Term
from pipeline.discrepancy.posterior.noise import Noise, has_past, learn_noise
from pipeline.discrepancy.posterior.products import NO_COEFFICIENTS, Prior, Products, beside_nuisance
from pipeline.discrepancy.posterior.repeatability import Basis, basis_of, learn_sizes
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
CERTAIN, UNKNOWN = 1e12, 1e-6  # precision of what is known; share of the prior's where nothing is
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

    def speed(self, joint: int) -> np.ndarray:
        """(N,) velocity where the joint counts, 0 elsewhere."""
        return np.asarray(self.weight[:, joint] * self.velocity[:, joint])


class Found(NamedTuple):
    """A group of terms: one family on one joint, with or without an onset.

    Attributes:
        evidence: Log Bayes factor over none, the mean over its terms.
        best: Index of its most probable term.
    """

    evidence: float
    best: int


class NominalJoint(NamedTuple):
    """What nominal logs say of one joint's residual.

    Attributes:
        noise: Of its rows.
        basis: What varies from session to session.
        variance: (K,) of the coefficients of `basis`.
        floor: Mean square of the residual on rows that count.
    """

    noise: Noise
    basis: Basis
    variance: np.ndarray
    floor: float


def learn_joint(
    joint: int, nominal: Rows, terms: Sequence[Term], length_s: float, present: Collection[str]
) -> NominalJoint:
    """Learn noise and repeatability.

    Args:
        joint: Index.
        nominal: Rows that the members of the model did not see.
        terms: Of the joint.
        length_s: Mean length of the measured sessions.
        present: Families of effects that nominal logs show themselves.
    """
    residual, state = nominal.columns.residual[:, joint], nominal.facts.state[:, joint]
    counts = nominal.weight[:, joint] > 0.0
    velocity = nominal.speed(joint)
    noise = learn_noise(residual, state, nominal.facts.run, counts, velocity)
    part = _parts(nominal.facts.session)
    raw, _ = raw_columns(joint, nominal, part)
    matrix = noise.whiten(raw.astype(np.float32), state, nominal.facts.run, velocity)
    speed = np.arange(nominal.columns.matrices[joint].shape[1], matrix.shape[1] - 1)
    basis = basis_of(terms, speed, deviations(length_s, USUAL_TIME_S, USUAL_DEVIATION))
    scaled = np.column_stack([matrix[:, basis.columns] * basis.scale, matrix[:, -1]])
    of_part = [scaled[part == number] for number in np.unique(part)]
    sizes = learn_sizes([rows.T @ rows for rows in of_part], [len(rows) for rows in of_part], basis.families)
    # What nominal logs show themselves is no scatter: it is what the model lacks.
    of_scatter = {family: 0.0 if family in present else size for family, size in sizes.items()}
    variance = np.array([of_scatter[family] for family in basis.families]) * basis.scale**2
    floor = max(float(np.mean(residual[counts] ** 2)) if counts.any() else 0.0, 1e-18)
    return NominalJoint(noise, basis, variance, floor)


def raw_columns(joint: int, rows: Rows, part: np.ndarray) -> tuple[np.ndarray, float]:
    """(N, M + 1) columns, slow variations of speed over each part, and the residual; and a part's mean length, s."""
    over_time, length_s = cosines(rows.facts.stamp_ns, part)
    speed = rows.speed(joint)[:, None]
    both = [rows.columns.matrices[joint], speed * over_time, rows.columns.residual[:, joint, None]]
    return np.column_stack(both), length_s


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
        self._bases = list(range(len(self.terms)))  # each term's own, or the one that sets in
        self._setting_in: list[tuple[int, int]] = []  # columns of terms that set in, and the moments
        _, length_s = cosines(measured.facts.stamp_ns, measured.facts.session)
        self.nominal = learn_joint(joint, nominal, self.terms, length_s, present)
        self._prepare(measured)

    def on(self, measured: Rows) -> "JointEvidence":
        """The same terms on other rows of the same logs."""
        other = copy.copy(self)
        other._prepare(measured)
        return other

    def _prepare(self, measured: Rows) -> None:
        self._measured, self._session = measured, measured.facts.session
        raw, self.length_s = raw_columns(self.joint, measured, self._session)
        n_column = measured.columns.matrices[self.joint].shape[1]
        self.speed = np.arange(n_column, raw.shape[1] - 1)
        is_counted = measured.weight[:, self.joint] > 0.0
        self._of_floor = self._share_of_floor(raw[is_counted][:, self.nominal.basis.columns])
        self._is_told = has_past(measured.facts.run) & is_counted
        self.matrix = self._whiten(raw)
        self._extend(self._setting_in)

    def _whiten(self, values: np.ndarray) -> np.ndarray:
        facts, velocity = self._measured.facts, self._measured.speed(self.joint)
        state = facts.state[:, self.joint]
        return self.nominal.noise.whiten(values.astype(np.float32), state, facts.run, velocity)

    def _extend(self, setting_in: Sequence[tuple[int, int]]) -> None:
        """Put columns that set in before the residual."""
        if setting_in:
            matrix, stamp_ns = self._measured.columns.matrices[self.joint], self._measured.facts.stamp_ns
            added = np.stack([matrix[:, of] * (stamp_ns >= moment) for of, moment in setting_in], axis=1)
            self.matrix = np.column_stack([self.matrix[:, :-1], self._whiten(added), self.matrix[:, -1]])
        self._groups: dict[tuple[int, ...], tuple[dict[Group, Found], np.ndarray]] = {}
        self._points: dict[tuple, dict[tuple, Found]] = {}
        self._fits: dict[tuple, tuple[float, Fit]] = {}

    def _share_of_floor(self, columns: np.ndarray) -> np.ndarray:
        """(K,) variances with which the nuisance of all families makes up the squares of the nominal residual.

        Args:
            columns: (N, K) of the nuisance on measured rows that count.
        """
        floor, families = self.nominal.floor, list(self.nominal.basis.families)
        squares = np.sum(columns**2, axis=0, dtype=float) / max(len(columns), 1)
        members = np.array([families.count(family) for family in families])
        return np.asarray(floor / (np.maximum(squares, 1e-6 * floor) * members * len(set(families))))

    def _sessions(self) -> list[np.ndarray]:
        """Per session the rows that tell, (N,) bool."""
        return [self._is_told & (self._session == number) for number in np.unique(self._session)]

    def moments(self) -> list[int]:
        """Stamps at which an effect may set in, evenly over all sessions but for their edges."""
        facts = self._measured.facts
        edge, step = int(SESSION_EDGE_S * 1e9), int(ONSET_STEP_S * 1e9)
        of_session = [facts.stamp_ns[facts.session == number] for number in np.unique(facts.session)]
        ends = [(int(stamps.min()) + edge, int(stamps.max()) - edge) for stamps in of_session]
        step = max(step, sum(last - first for first, last in ends) // MOST_MOMENTS)
        return [moment for first, last in ends for moment in range(first, last, step)]

    def let_set_in(self, terms: Sequence[int], moments: Sequence[int]) -> None:
        """Add terms that set in: each of the given ones, which do not, at each moment."""
        added: list[tuple[int, int]] = []
        first = self.matrix.shape[1] - 1
        for index in terms:
            term, known = self.terms[index], {self.onsets[other] for other in self.setting_in(index)}
            for moment in moments:
                if moment in known:
                    continue
                columns = tuple(range(first + len(added), first + len(added) + len(term.columns)))
                added += [(column, moment) for column in term.columns]
                self.terms.append(term._replace(columns=columns))
                self.onsets.append(moment)
                self._bases.append(index)
        self._setting_in += added
        self._extend(added)

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
        """Every group of terms beside given ones, and (n_terms,) log Bayes factors, with normal noise."""
        key = tuple(sorted(beside))
        if key not in self._groups:
            evidence = term_evidence(self.products_beside(key), self.terms)
            members: dict[Group, list[int]] = defaultdict(list)
            for index, (term, onset) in enumerate(zip(self.terms, self.onsets, strict=True)):
                members[term.family, term.source, onset is not None].append(index)
            found = {
                group: _mean(evidence, indices, self.n_alternatives(indices[0]))
                for group, indices in members.items()
            }
            self._groups[key] = found, evidence
        return self._groups[key]

    def points(self, family: str, sets_in: bool, beside: Sequence[int]) -> dict[tuple, Found]:
        """Terms of a family by moment and grid point, which joints may have in common; beside given terms."""
        key = family, sets_in, tuple(sorted(beside))
        if key not in self._points:
            _, evidence = self.groups(beside)
            members: dict[tuple, list[int]] = defaultdict(list)
            for index, (term, onset) in enumerate(zip(self.terms, self.onsets, strict=True)):
                if term.family == family and (onset is not None) == sets_in:
                    members[(onset, *sorted(term.point.items()))].append(index)
            self._points[key] = {point: _mean(evidence, of, len(of)) for point, of in members.items()}
        return self._points[key]

    def products_beside(self, terms: Sequence[int], least: float | None = None) -> Products:
        """Of all columns beside given terms. The noise is normal here, with the weights of rows that they leave.

        Args:
            terms: By index.
            least: τ; None: that of greatest evidence.
        """
        most_probable, fitted = self._least(tuple(sorted(terms)))
        least = most_probable if least is None else least
        weighted = [
            self.matrix[session] * np.sqrt(weight)[:, None].astype(np.float32)
            for session, weight in zip(self._sessions(), fitted.weights, strict=True)
        ]
        products = beside_nuisance(weighted, self.nominal.basis.columns, self._variance(least))
        return products.beside(self.prior(terms))

    def _variance(self, least: float) -> np.ndarray:
        """(K,) of the nuisance's coefficients."""
        return self.nominal.variance + least * self._of_floor

    def n_alternatives(self, index: int) -> int:
        """How many terms stand for the cause of a term, each as probable before any row is seen.

        Of what sets in, each moment with each term of what does not.
        """
        alike = self._alike(index)
        n = sum(self.onsets[other] is None for other in alike)
        return n if self.onsets[index] is None else n * self._n_moments(alike)

    def n_choices(self, index: int) -> int:
        """How many grid points the family of a term has, with each moment if it sets in."""
        alike = self._alike(index)
        n_points = len({tuple(sorted(self.terms[other].point.items())) for other in alike})
        return n_points if self.onsets[index] is None else n_points * self._n_moments(alike)

    def _n_moments(self, terms: Sequence[int]) -> int:
        return len({self.onsets[index] for index in terms} - {None})

    def without_onset(self, family: str) -> list[int]:
        """Terms of a family that act all the time."""
        pairs = zip(self.terms, self.onsets, strict=True)
        return [index for index, (term, onset) in enumerate(pairs) if term.family == family and onset is None]

    def base(self, index: int) -> int:
        """The term that acts all the time, of one that sets in."""
        return self._bases[index]

    def setting_in(self, base: int) -> list[int]:
        """Terms in which a term sets in, at any moment."""
        return [other for other, of in enumerate(self._bases) if of == base and other != base]

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
                self.matrix[session][:, self.nominal.basis.columns] * np.sqrt(variance).astype(np.float32),
                self.matrix[session][:, -1],
                self.nominal.noise.degrees,
                self.nominal.noise.scale,
            )
            for session in self._sessions()
        ]

    def speed_columns(self) -> list[np.ndarray]:
        """Slow variations of speed, whitened, for each of `blocks`."""
        return [self.matrix[session][:, self.speed] for session in self._sessions()]

    def fit(self, terms: Sequence[int], speed: tuple[float, float] | None = None) -> Fit:
        """Terms together, with heavy-tailed noise, at the τ of greatest evidence."""
        return self._least(tuple(sorted(terms)), speed)[1]

    def evidence_of_nothing(self, least: float) -> float:
        """Log evidence without any effect, at a given τ."""
        return fit(self.blocks((), least), NO_COEFFICIENTS).evidence

    def likelihood_of(self, terms: Sequence[int], fitted: "JointEvidence") -> float:
        """Log likelihood of terms with all that was fitted to them on other rows."""
        key = tuple(sorted(terms))
        least, known = fitted._least(key)
        prior = self.prior(key)
        exactly = prior._replace(mean=known.coefficients, precision=np.full(len(prior.mean), CERTAIN))
        return fit(self.blocks(key, least), exactly, known.noisier).likelihood

    def likelihood_of_residual(
        self, residual: np.ndarray, terms: Sequence[int], fitted: "JointEvidence"
    ) -> float:
        """Log likelihood of effects that leave a residual, with the noise that was fitted beside terms elsewhere.

        Args:
            residual: (N,) in the presence of the effects.
            terms: That stand for them.
            fitted: The joint on the rows that they were fitted on.
        """
        least, known = fitted._least(tuple(sorted(terms)))
        whitened = self._whiten(residual[:, None])[:, 0]
        blocks = [
            block._replace(residual=whitened[session])
            for block, session in zip(self.blocks((), least), self._sessions(), strict=True)
        ]
        return fit(blocks, NO_COEFFICIENTS, known.noisier).likelihood

    def greatest_likelihood(self, terms: Sequence[int]) -> float:
        """Log likelihood of terms with whatever values fit best."""
        key = tuple(sorted(terms))
        prior = self.prior(key)
        free = prior._replace(precision=UNKNOWN * prior.precision)
        return max(fit(self.blocks(key, least), free).likelihood for least in LEAST_SHARES)

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


def _mean(evidence: np.ndarray, indices: Sequence[int], n: int) -> Found:
    """Of terms by index, if there are n that are as probable before any row is seen."""
    best = indices[int(np.argmax(evidence[indices]))]
    of_all = evidence[best] + np.log(np.sum(np.exp(evidence[indices] - evidence[best])))
    return Found(float(of_all - np.log(n)), best)


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
