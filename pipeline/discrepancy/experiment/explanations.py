"""The explanations that remain: effects with their values, and how far each value may be chosen anew."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.diagnosis.nominal.noise import noise_of
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Hypothesis, Simulation
from pipeline.discrepancy.experiment.evidence import pair_sums
from pipeline.discrepancy.families.plausibility import CHANNEL, THERMAL_DRIFT, TIMING
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.selection.candidate import Candidate, with_candidate
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.linear_parameters import USUAL_SHARE, bounds_of
from pipeline.discrepancy.selection.selected_effect import hypothesis_of
from pipeline.effects.catalogue import WITH_AN_EQUATION
from pipeline.effects.effect import Effect

NOTHING = "no change"
SMALL = 1 / 3  # of a usual size
# Natural logarithm of 1000: odds beyond which evidence is called decisive, Kass and Raftery (1995), Bayes Factors,
# Journal of the American Statistical Association 90, take 150; here many families are weighed at once.
DECISIVE = 6.9


class Freedom(NamedTuple):
    """A value that a fit to new logs may choose anew.

    Attributes:
        family: Of the effect.
        places: Entries of its arrays that move together: parameter and index.
        deviation: How far, as a standard deviation.
        lower: The most that its entries may fall by, and ...
        upper: ... rise by, as far as is plausible.
    """

    family: str
    places: tuple[tuple[str, tuple[int, ...]], ...]
    deviation: float
    lower: float
    upper: float

    @property
    def way(self) -> float:
        """1 or -1: the way that has more room."""
        return 1.0 if self.upper >= -self.lower else -1.0

    @property
    def shares(self) -> tuple[float, float]:
        """Of the deviation, by which it falls and rises by no more than that."""
        return max(-1.0, self.lower / self.deviation), min(1.0, self.upper / self.deviation)


class Explanation(NamedTuple):
    """One way to explain the logs.

    Attributes:
        name: Family and joint, as an operator reads it.
        joints: Indices of the joints that the others are told from it by.
        hypothesis: Values of all its effects.
        freedoms: Of the effects that tell it from others.
    """

    name: str
    joints: tuple[int, ...]
    hypothesis: Hypothesis
    freedoms: tuple[Freedom, ...]

    def varied(self, freedom: Freedom, share: float) -> Hypothesis:
        """With one value moved by a share of its deviation."""
        values = {
            family: {name: np.array(value, float) for name, value in of.items()}
            for family, of in self.hypothesis.values.items()
        }
        for name, index in freedom.places:
            change = share * freedom.deviation
            values[freedom.family][name][index] += np.clip(change, freedom.lower, freedom.upper)
        return Hypothesis(values)


class Remaining(NamedTuple):
    """What is to be told apart.

    Attributes:
        explanations: With an equation.
        pairs: Indices of every two that are to be told apart, the one taken to be true first.
        left_out: Names of those without an equation, or on a channel, whose course nobody knows beforehand.
    """

    explanations: Sequence[Explanation]
    pairs: Sequence[tuple[int, int]]
    left_out: Sequence[str]


def rivals_of(
    simulation: Simulation, effects: Sequence[MachineEffect], joints: Sequence[str]
) -> Remaining | None:
    """The first effect with equivalents, and these, each beside all other effects; None: there is none.

    Args:
        simulation: Which knows the effects.
        effects: Of the verdict.
        joints: Names of the machine's joints.
    """
    doubted = next((effect for effect in effects if effect.equivalents), None)
    if doubted is None:
        return None
    beside = [member for effect in effects if effect is not doubted for member in effect.members]
    certain = Hypothesis(hypothesis_of(simulation, beside).values)
    rivals = [[member.candidate for member in doubted.members], *([c] for c in doubted.equivalents)]
    known = [of for of in rivals if all(has_wrapper(c) and c.family != CHANNEL for c in of)]
    left_out = [_name(of, joints) for of in rivals if of not in known]
    explanations = [_explanation(simulation, certain, of, joints) for of in known]
    pairs = [(a, b) for a in range(len(known)) for b in range(len(known)) if a != b]
    return Remaining(explanations, pairs, left_out) if pairs else None


def _name(candidates: Sequence[Candidate], joints: Sequence[str]) -> str:
    where = ", ".join(dict.fromkeys(joints[candidate.joint] for candidate in candidates))
    return f"{candidates[0].family} ({where})"


def _explanation(
    simulation: Simulation,
    beside: Hypothesis,
    candidates: Sequence[Candidate],
    joints: Sequence[str],
    size: float = 1.0,
) -> Explanation:
    """Candidates beside a hypothesis; values deviate by `size` times the usual."""
    hypothesis, freedoms = beside, []
    for candidate in candidates:
        hypothesis = with_candidate(simulation, hypothesis, candidate)
        freedoms += _freedoms(simulation.effects[candidate.family], candidate, size * USUAL_SHARE)
    at = tuple(dict.fromkeys(candidate.joint for candidate in candidates))
    return Explanation(_name(candidates, joints), at, Hypothesis(hypothesis.values), tuple(freedoms))


def _freedoms(effect: Effect, candidate: Candidate, share: float) -> list[Freedom]:
    """A share of what is plausible of each value, as before any row is seen (`linear_parameters.py`)."""
    found, joint = [], candidate.joint
    for parameter in effect.card.parameters:
        if parameter.name in candidate.point:
            value, size = candidate.point[parameter.name], float(effect.sizes(parameter.name)[joint])
            lowest, highest = size * parameter.lower, size * parameter.upper
            places = ((parameter.name, (joint,)),)
            reach = min(lowest - value, 0.0), max(highest - value, 0.0)
            found.append(Freedom(candidate.family, places, share * (highest - lowest), *reach))
    bounds = bounds_of(effect, candidate.freed)
    for freed, value, lowest, highest in zip(
        candidate.freed, candidate.coefficients.tolist(), *(of.tolist() for of in bounds), strict=True
    ):
        entries = tuple(
            (name, (joint,) if index is None else (joint, *np.atleast_1d(index).tolist()))
            for name, index in freed
        )
        reach = min(lowest - value, 0.0), max(highest - value, 0.0)
        found.append(Freedom(candidate.family, entries, share * (highest - lowest), *reach))
    return found


def unseen_in(diagnosis: Diagnosis, joints: Sequence[int]) -> Remaining | None:
    """No change, and every small effect on the joints that the logs would not have shown; None: they show all."""
    names = diagnosis.logs.joints
    small = [of for of in small_effects(diagnosis.simulation, names) if not set(joints).isdisjoint(of.joints)]
    velocities = diagnosis.simulation.velocities([NOMINAL, *(of.hypothesis for of in small)])
    noise = noise_of(diagnosis.nominal, diagnosis.logs.machine.dt_s)
    used = diagnosis.rows.is_used
    known = diagnosis.is_known[used]
    expected = [
        pair_sums(of[used], velocities[0][used], [], known, noise).evidence() for of in velocities[1:]
    ]
    unseen = [of for of, evidence in zip(small, expected, strict=True) if evidence < DECISIVE]
    if not unseen:
        return None
    nothing = Explanation(NOTHING, (), NOMINAL, ())
    return Remaining([nothing, *unseen], [(k, 0) for k in range(1, len(unseen) + 1)], [])


def small_effects(simulation: Simulation, joints: Sequence[str]) -> list[Explanation]:
    """Every named family on every joint, at the first point of its grid and a third of a usual coefficient.

    A late channel and cold oil are effects of the whole machine: their parts on one joint are a delay and a gain.
    """
    found = []
    for family, effect in simulation.effects.items():
        if family not in WITH_AN_EQUATION or family in (TIMING, THERMAL_DRIFT):
            continue
        point = effect.grid()[0]
        variant = max(effect.variants(), key=len, default=())
        for joint in range(len(joints)):
            sized = {name: float(effect.sizes(name)[joint] * value) for name, value in point.items()}
            lower, upper = bounds_of(effect, variant)
            # the way that has more room: slower, later, looser
            sign = np.where(upper > -lower, 1.0, -1.0)
            coefficients = sign * SMALL * USUAL_SHARE * (upper - lower)
            candidate = Candidate(family, joint, None, sized, variant, coefficients, 0.0, 0.0, np.zeros(0))
            found.append(_explanation(simulation, NOMINAL, [candidate], joints, SMALL))
    return found
