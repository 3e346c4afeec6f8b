"""How far the posterior may trust its evidence: the exponents at which solved cases are most probable.

    python -m benchmarks.closed_loop.calibrate ROOT

Reads the explanations in the solutions below ROOT, which `close_loop.engine=posterior` writes, and opens the seals.
Told are the two exponents of `pipeline.discrepancy.posterior.probabilities`, each with its interval over machines, and
reliability tables at these, at those that stand, and at 1. `OF_ANY` has the greatest mean log probability of "none" or
"any", whichever is right; `OF_NAMES` that of the true effects among explanations with an effect. Source: temperature
scaling, Guo et al. (2017), On calibration of modern neural networks.
"""

import argparse
import itertools
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.folders import Folders
from benchmarks.closed_loop.intervals import over_machines
from benchmarks.closed_loop.score import records
from benchmarks.closed_loop.truth import Truth
from pipeline.discrepancy.posterior.explanations import Cause
from pipeline.discrepancy.posterior.findings import findings_of
from pipeline.discrepancy.posterior.probabilities import OF_ANY, OF_NAMES, log_probabilities

EXPONENTS = np.geomspace(0.02, 2.0, 60)
STRANGE = 0.01  # share of cases in which any explanation may be right, whatever the evidence says
BINS = (0.0, 0.5, 0.9, 0.99, 1.0)


class Weighed(NamedTuple):
    """The explanations of a case.

    Attributes:
        machine: Simulator and number.
        log_prior: (n,).
        log_evidence: (n,).
        is_none: (n,) whether it has no effect.
        is_right: (n,) whether it tells each true effect, or none where there is none.
    """

    machine: tuple[str, int]
    log_prior: np.ndarray
    log_evidence: np.ndarray
    is_none: np.ndarray
    is_right: np.ndarray

    @property
    def has_effect(self) -> bool:
        """Whether an explanation with an effect is right, or none of all."""
        return not self.is_right[self.is_none].any()

    def probability(self, of_any: float, of_names: float) -> np.ndarray:
        """(n,)."""
        return np.exp(log_probabilities(self.log_prior, self.log_evidence, self.is_none, of_any, of_names))

    def score_of_any(self, exponent: float) -> float:
        """Log probability of "any" or "none", whichever is right."""
        right = float(self.probability(exponent, 1.0)[self.is_none != self.has_effect].sum())
        return float(np.log((1.0 - STRANGE) * right + STRANGE / 2))

    def score_of_names(self, exponent: float) -> float:
        """Log probability of the true effects, given that there is any."""
        of = ~self.is_none
        none = np.zeros(of.sum(), bool)
        p = np.exp(log_probabilities(self.log_prior[of], self.log_evidence[of], none, of_names=exponent))
        return float(
            np.log((1.0 - STRANGE) * p[self.is_right[of]].sum() + STRANGE * self.is_right[of].mean())
        )


def weighed(truth: Truth, explanations: Sequence[Mapping[str, Any]]) -> Weighed:
    """A case with its truth, and what `trace.explanations` says of it."""
    of = {name: np.array([float(e[name]) for e in explanations]) for name in ("log_prior", "log_evidence")}
    right = np.array([is_right(truth, explanation["causes"]) for explanation in explanations])
    none = np.array([not explanation["causes"] for explanation in explanations])
    return Weighed((truth.simulator, truth.number), of["log_prior"], of["log_evidence"], none, right)


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


def best_exponent(
    cases: Sequence[Weighed], score: Callable[[Weighed, float], float]
) -> tuple[float, tuple[float, float]]:
    """The exponent of the greatest mean log score, and its 95 % interval over machines."""
    of_machines: dict[tuple[str, int], list[int]] = defaultdict(list)
    for number, case in enumerate(cases):
        of_machines[case.machine].append(number)
    scores = np.array([[score(case, float(w)) for w in EXPONENTS] for case in cases])

    def best(drawn: np.ndarray) -> float:
        return float(EXPONENTS[int(np.argmax(scores[drawn.astype(int)].mean(axis=0)))])

    return best(np.arange(len(cases))), over_machines(list(of_machines.values()), best)


def reliability(
    cases: Sequence[Weighed], of_any: float, of_names: float
) -> list[tuple[float, float, int, float, float]]:
    """Per bin of the best explanation's probability: edges, cases, mean probability, and share of right ones."""
    best = [
        (p.max(), case.is_right[int(np.argmax(p))])
        for case in cases
        for p in [case.probability(of_any, of_names)]
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
    cases = [weighed(truth, of) for truth, of in found if of]
    named = [case for case in cases if case.has_effect and case.is_right.any()]
    if not named or len(named) == len(cases):
        parser.error(f"{folders.solutions}: needs cases with and without an effect, solved by the posterior")
    of_any, interval = best_exponent(cases, Weighed.score_of_any)
    print(f"{len(cases)} cases: OF_ANY {of_any:.2f} ({interval[0]:.2f} to {interval[1]:.2f})")
    of_names, interval = best_exponent(named, Weighed.score_of_names)
    print(
        f"{len(named)} with a right explanation: OF_NAMES {of_names:.2f} ({interval[0]:.2f} to {interval[1]:.2f})"
    )
    for any_, names in ((of_any, of_names), (OF_ANY, OF_NAMES), (1.0, 1.0)):
        scores = np.mean([case.score_of_any(any_) for case in cases])
        of_right = np.mean([case.score_of_names(names) for case in named])
        print(
            f"\n{any_:.2f}, {names:.2f}: mean log probability of what is right {scores:.2f} and {of_right:.2f}"
        )
        for low, high, n, p, share in reliability(cases, any_, names):
            print(f"  best explanation {low:.2f} to {high:.2f}: {n} cases, mean {p:.3f}, right {share:.2f}")


if __name__ == "__main__":
    main()
