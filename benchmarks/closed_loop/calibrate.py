"""How far the posterior may trust its evidence: the exponent at which solved cases are most probable.

    python -m benchmarks.closed_loop.calibrate ROOT

Reads the explanations in the solutions below ROOT, which `close_loop.engine=posterior` writes, and opens the seals.
With exponent w, an explanation has a probability in proportion to prior · evidence^w. Told is the w of the greatest
mean log probability of the true explanation, with its interval over machines, and a reliability table at that w and
at 1. Source: temperature scaling, Guo et al. (2017), On calibration of modern neural networks; of evidence: Grünwald
and van Ommen (2017), Inconsistency of Bayesian inference for misspecified linear models.
"""

import argparse
import itertools
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.folders import Folders
from benchmarks.closed_loop.intervals import over_machines
from benchmarks.closed_loop.score import records
from benchmarks.closed_loop.truth import Truth
from pipeline.discrepancy.posterior.explanations import Cause
from pipeline.discrepancy.posterior.findings import findings_of

EXPONENTS = np.geomspace(0.02, 2.0, 60)
STRANGE = 0.01  # share of cases in which any explanation may be right, whatever the evidence says
BINS = (0.0, 0.5, 0.9, 0.99, 1.0)


class Weighed(NamedTuple):
    """The explanations of a case.

    Attributes:
        machine: Simulator and number.
        log_prior: (n,).
        log_evidence: (n,).
        is_right: (n,) whether it tells each true effect, or none where there is none.
    """

    machine: tuple[str, int]
    log_prior: np.ndarray
    log_evidence: np.ndarray
    is_right: np.ndarray

    def probability(self, exponent: float) -> np.ndarray:
        """(n,)."""
        score = self.log_prior + exponent * self.log_evidence
        return np.asarray(np.exp(score - logsumexp(score)))

    def log_score(self, exponent: float) -> float:
        """Log probability of what is right; some explanation has to be."""
        right = float(self.probability(exponent)[self.is_right].sum())
        return float(np.log((1.0 - STRANGE) * right + STRANGE * self.is_right.mean()))


def weighed(truth: Truth, explanations: Sequence[Mapping[str, Any]]) -> Weighed:
    """A case with its truth, and what `trace.explanations` says of it."""
    of = {name: np.array([float(e[name]) for e in explanations]) for name in ("log_prior", "log_evidence")}
    right = np.array([is_right(truth, explanation["causes"]) for explanation in explanations])
    return Weighed((truth.simulator, truth.number), of["log_prior"], of["log_evidence"], right)


def is_right(truth: Truth, causes: Sequence[Mapping[str, Any]]) -> bool:
    """Whether causes, as the trace has them, are told as the true effects, each on one of its joints at least."""
    told = [
        (of.family, set(of.joints), of.label[2])
        for of in findings_of(
            [Cause(c["family"], None, {}, tuple(c["joints"]), c["sets_in"], 0.0) for c in causes]
        )
    ]
    if len(told) != len(truth.effects):
        return False
    return all(
        any(
            family == (effect.of or effect.family)
            and bool(joints & set(effect.joints))
            and sets_in == (truth.kind in (kinds.CHANGE_POINT, kinds.RAMP))
            for family, joints, sets_in in told
        )
        for effect in truth.effects
    )


def best_exponent(cases: Sequence[Weighed]) -> tuple[float, tuple[float, float]]:
    """The exponent of the greatest mean log score, and its 95 % interval over machines."""
    of_machines: dict[tuple[str, int], list[int]] = defaultdict(list)
    for number, case in enumerate(cases):
        of_machines[case.machine].append(number)
    scores = np.array([[case.log_score(float(w)) for w in EXPONENTS] for case in cases])

    def best(drawn: np.ndarray) -> float:
        return float(EXPONENTS[int(np.argmax(scores[drawn.astype(int)].mean(axis=0)))])

    return best(np.arange(len(cases))), over_machines(list(of_machines.values()), best)


def reliability(cases: Sequence[Weighed], exponent: float) -> list[tuple[float, float, int, float, float]]:
    """Per bin of the best explanation's probability: edges, cases, mean probability, and share of right ones."""
    best = [
        (p.max(), case.is_right[int(np.argmax(p))]) for case in cases for p in [case.probability(exponent)]
    ]
    table = []
    for low, high in itertools.pairwise(BINS):
        inside = [(p, right) for p, right in best if low <= p < high or (high == BINS[-1] and p >= high)]
        if inside:
            mean, share = np.mean(np.array(inside, float), axis=0)
            table.append((low, high, len(inside), float(mean), float(share)))
    return table


def main() -> None:
    parser = argparse.ArgumentParser(prog="calibrate", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("root", type=Path)
    folders = Folders(parser.parse_args().root.resolve())
    found = [
        (r.truth, (r.solution.answer or {}).get("trace", {}).get("explanations")) for r in records(folders)
    ]
    every = [weighed(truth, of) for truth, of in found if of]
    cases = [case for case in every if case.is_right.any()]
    if not cases:
        parser.error(f"{folders.solutions}: no case was solved with close_loop.engine=posterior")
    exponent, (lower, upper) = best_exponent(cases)
    print(f"{len(cases)} of {len(every)} cases, in which some explanation is right")
    print(f"exponent {exponent:.2f} ({lower:.2f} to {upper:.2f})")
    for of in (exponent, 1.0):
        mean = np.mean([case.log_score(of) for case in cases])
        print(f"\nexponent {of:.2f}: mean log probability of what is right {mean:.2f}")
        for low, high, n, p, share in reliability(cases, of):
            print(f"  best explanation {low:.2f} to {high:.2f}: {n} cases, mean {p:.3f}, right {share:.2f}")


if __name__ == "__main__":
    main()
