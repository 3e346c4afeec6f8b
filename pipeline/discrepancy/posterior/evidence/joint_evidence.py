"""All that the logs say of one joint: its columns, noise and nuisance, and the evidence of any set of terms."""

import copy
from collections import defaultdict
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.posterior.evidence.nominal_joint import (
    LEAST_SHARES,
    Rows,
    learn_joint,
    raw_columns,
    share_of_squares,
)
from pipeline.discrepancy.posterior.evidence.products import NO_COEFFICIENTS, Prior, Products, beside_nuisance
from pipeline.discrepancy.posterior.evidence.robust_evidence import Block, Fit, fit
from pipeline.discrepancy.posterior.evidence.term_evidence import term_evidence
from pipeline.discrepancy.posterior.residual.columns import Term
from pipeline.discrepancy.posterior.residual.noise import has_past
from pipeline.discrepancy.posterior.residual.speed_in_time import cosines, deviations

CARD_ERRORS = (0.03, 0.1, 0.3)  # of what an effect adds: how far its card may be off; by factors of three
SESSION_EDGE_S, ONSET_STEP_S = 20.0, 10.0
MOST_MOMENTS = 120  # over all logs: of longer ones the moments are further apart
CERTAIN, UNKNOWN = 1e12, 1e-6  # precision of what is known; share of the prior's where nothing is
Group = tuple[str, int | None, bool]  # family, source, and whether it sets in


class Found(NamedTuple):
    """A group of terms: one family on one joint, with or without an onset.

    Attributes:
        evidence: Log Bayes factor over none, the mean over its terms.
        best: Index of its most probable term.
    """

    evidence: float
    best: int


class Scatter(NamedTuple):
    """How large the nuisance is.

    Attributes:
        least: τ.
        of_cards: Mean square of what the cards of effects may leave over, whitened.
    """

    least: float
    of_cards: float = 0.0


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
        n_column, n_members = measured.columns.matrices[self.joint].shape[1], measured.spread.shape[2]
        members = np.arange(n_column, n_column + n_members)
        # Were the machine one more member, its deviation from all would be theirs times coefficients of this variance.
        self._of_members = np.full(n_members, (1.0 + 1.0 / n_members) / max(n_members - 1.0, 1.0))
        self.speed = np.arange(n_column + n_members, raw.shape[1] - 1)
        self._is_told = has_past(measured.facts.run) & (measured.weight[:, self.joint] > 0.0)
        self.matrix = self._whiten(raw)
        self._misfit = self.matrix[:, self.nominal.basis.columns] @ self.nominal.misfit.astype(np.float32)
        self.matrix[:, -1] -= self._misfit
        basis = self.nominal.basis
        self._nuisance = np.concatenate([members, basis.columns])
        self._of_one = share_of_squares(self.matrix[self._is_told][:, basis.columns], basis.families, 1.0)
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
        self._fits: dict[tuple, tuple[Scatter, Fit]] = {}

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

    def products_beside(self, terms: Sequence[int], scatter: Scatter | None = None) -> Products:
        """Of all columns beside given terms. The noise is normal here, with the weights of rows that they leave.

        Args:
            terms: By index.
            scatter: None: that of greatest evidence.
        """
        most_probable, fitted = self._fitted(tuple(sorted(terms)))
        weighted = [
            self.matrix[session] * np.sqrt(weight)[:, None].astype(np.float32)
            for session, weight in zip(self._sessions(), fitted.weights, strict=True)
        ]
        variance = self._variance(scatter or most_probable)
        return beside_nuisance(weighted, self._nuisance, variance).beside(self.prior(terms))

    def _variance(self, scatter: Scatter) -> np.ndarray:
        """(K,) of the nuisance's coefficients."""
        of_machine = self.nominal.variance + scatter.least * self.nominal.of_floor
        return np.concatenate([self._of_members, of_machine + scatter.of_cards * self._of_one])

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
        self, terms: Sequence[int], scatter: Scatter, speed: tuple[float, float] | None = None
    ) -> list[Block]:
        """Rows per session, with the columns of terms.

        Args:
            terms: Indices, whose `prior` the columns are in the order of.
            scatter: Of the nuisance.
            speed: Correlation time, s, and deviation of slow variations of speed beside those of nominal logs.
        """
        variance = self._variance(scatter)
        if speed is not None:
            variance[-len(self.speed) :] += deviations(self.length_s, *speed) ** 2
        columns = self.prior(terms).columns
        return [
            Block(
                self.matrix[session][:, columns],
                self.matrix[session][:, self._nuisance] * np.sqrt(variance).astype(np.float32),
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
        """Terms together, with heavy-tailed noise, at the scatter of greatest evidence."""
        return self._fitted(tuple(sorted(terms)), speed)[1]

    def evidence_of_nothing(self, least: float) -> float:
        """Log evidence without any effect, at a given τ."""
        return self._at((), Scatter(least), NO_COEFFICIENTS).evidence

    def likelihood_of(self, terms: Sequence[int], fitted: "JointEvidence") -> float:
        """Log likelihood of terms with all that was fitted to them on other rows."""
        key = tuple(sorted(terms))
        scatter, known = fitted._fitted(key)
        prior = self.prior(key)
        exactly = prior._replace(mean=known.coefficients, precision=np.full(len(prior.mean), CERTAIN))
        return fit(self.blocks(key, scatter), exactly, known.noisier).likelihood

    def likelihood_of_residual(
        self, residual: np.ndarray, terms: Sequence[int], fitted: "JointEvidence"
    ) -> float:
        """Log likelihood of effects that leave a residual, with the noise that was fitted beside terms elsewhere.

        Args:
            residual: (N,) in the presence of the effects.
            terms: That stand for them.
            fitted: The joint on the rows that they were fitted on.
        """
        scatter, known = fitted._fitted(tuple(sorted(terms)))
        whitened = self._whiten(residual[:, None])[:, 0] - self._misfit
        blocks = [
            block._replace(residual=whitened[session])
            for block, session in zip(self.blocks((), scatter), self._sessions(), strict=True)
        ]
        return fit(blocks, NO_COEFFICIENTS, known.noisier).likelihood

    def greatest_likelihood(self, terms: Sequence[int]) -> float:
        """Log likelihood of terms with whatever values fit best."""
        key = tuple(sorted(terms))
        prior = self.prior(key)
        free = prior._replace(precision=UNKNOWN * prior.precision)
        squares = self._squares(key, self.fit(key).coefficients)
        return max(self._at(key, scatter, free).likelihood for scatter in _scatters(LEAST_SHARES, squares))

    def least(self) -> float:
        """The τ of greatest evidence without any effect."""
        return self._fitted(())[0].least

    def _fitted(
        self, terms: tuple[int, ...], speed: tuple[float, float] | None = None
    ) -> tuple[Scatter, Fit]:
        """Terms with the scatter of greatest evidence.

        What their cards leave over is a share of what they add, and how much they add is known by a first fit.
        """
        key = terms, speed
        if key not in self._fits:
            prior = self.prior(terms)
            # Beside variations of speed little else varies in time.
            shares: Sequence[float] = LEAST_SHARES if speed is None else [self.least()]
            found = [(scatter, self._at(terms, scatter, prior, speed)) for scatter in _scatters(shares, 0.0)]
            if terms:
                squares = self._squares(terms, max(found, key=_evidence)[1].coefficients)
                others = _scatters(shares, squares)
                found += [(scatter, self._at(terms, scatter, prior, speed)) for scatter in others]
            self._fits[key] = max(found, key=_evidence)
        return self._fits[key]

    def _at(
        self, terms: Sequence[int], scatter: Scatter, prior: Prior, speed: tuple[float, float] | None = None
    ) -> Fit:
        """Terms at one scatter; how well nominal logs bear its τ out counts, too."""
        fitted, known = fit(self.blocks(terms, scatter, speed), prior), self.nominal.evidence[scatter.least]
        return fitted._replace(evidence=fitted.evidence + known, likelihood=fitted.likelihood + known)

    def _squares(self, terms: tuple[int, ...], coefficients: np.ndarray) -> float:
        """Mean square of what terms add, whitened."""
        added = self.matrix[self._is_told][:, self.prior(terms).columns] @ coefficients
        return float(np.sum(added**2) / max(len(added), 1))


def _scatters(shares: Sequence[float], squares: float) -> list[Scatter]:
    """Every τ with every error of the cards; none of these where effects add nothing."""
    of_cards = [share**2 * squares for share in CARD_ERRORS] if squares > 0.0 else [0.0]
    return [Scatter(least, of) for of in of_cards for least in shares]


def _evidence(found: tuple[Scatter, Fit]) -> float:
    return found[1].evidence


def _mean(evidence: np.ndarray, indices: Sequence[int], n: int) -> Found:
    """Of terms by index, if there are n that are as probable before any row is seen."""
    best = indices[int(np.argmax(evidence[indices]))]
    of_all = evidence[best] + np.log(np.sum(np.exp(evidence[indices] - evidence[best])))
    return Found(float(of_all - np.log(n)), best)
