"""Cases drawn by lot: which effects, how large, who drives, and the sessions that result.

Everything follows from the simulator and the case's number, which is also that of its machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from zlib import crc32

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.machines import FIRST_DAY, NOMINAL_MINUTES, Variant, variant
from benchmarks.closed_loop.sessions import Session
from benchmarks.closed_loop.simulator import Effect, Machine, Simulator
from benchmarks.closed_loop.truth import Onset, TrueEffect, Truth

LOT = crc32(b"cases of issue 50")  # seeds all that belongs to cases; machines have a seed of their own
MEASURED_MINUTES = (6.0, 6.0)
EXAM_MINUTES = 6.0
ONSET_SHARE = (0.3, 0.7)  # of the measured session in which an effect sets in
MEASURED_AFTER_DAYS = (20, 200)
OTHER_STYLE = 0.5  # probability
SMALLEST_SHARE = 0.1  # of a kind's largest size; sizes are log-uniform from there on
RAMP_STEP_S = 10.0
LOAD, LOAD_SHARE = (
    "load",
    0.25,
)  # what may vary among nominal sessions: a payload of that share of the largest


@dataclass(frozen=True)
class Drawn:
    """An effect that was drawn."""

    variant: Variant
    kind: str
    seed: int
    size: float

    def at(self, size: float) -> Effect:
        """The same effect at another size."""
        return self.variant.simulator.draw_effect(self.kind, self.seed, self.variant, size)


@dataclass(frozen=True)
class Plan:
    """A case before it is recorded.

    Attributes:
        nominal: Sessions.
        measured: Sessions.
        exam: Sessions.
        truth: Without visible sizes.
        without: Per true effect the machine that has all effects but this one.
        strongest: The same with this one at its largest size.
        largest: Those sizes.
    """

    nominal: tuple[Session, ...]
    measured: tuple[Session, ...]
    exam: tuple[Session, ...]
    truth: Truth
    without: tuple[Machine, ...]
    strongest: tuple[Machine, ...]
    largest: tuple[float, ...]


def draw_plan(simulator: Simulator, number: int, kind: str | None = None) -> Plan:
    """Draw a case: effects, operator and sessions.

    Args:
        simulator: Which it is drawn from.
        number: Of the case.
        kind: One of the simulator's, `kinds.in_order`; None: by lot.
    """
    random = np.random.default_rng([LOT, number, *simulator.entropy])
    machine = variant(simulator, number)
    by_lot = kinds.lot(random, number, simulator.outside)
    kind = kind or by_lot
    drawn = [
        Drawn(machine, of, int(random.integers(2**31)), _size(random, simulator.largest_size[of]))
        for of in kinds.effects_of(random, kind)
    ]
    is_other = random.random() < OTHER_STYLE
    style_seed = int(random.integers(2**31)) if is_other else machine.style_seed
    onset_session = int(random.integers(len(MEASURED_MINUTES)))
    onset_s = random.uniform(*ONSET_SHARE) * 60.0 * MEASURED_MINUTES[onset_session]
    effects = [one.at(one.size) for one in drawn]
    sound = _with_effects(
        machine.parameters, _payload(machine, random.random()) if kind == kinds.NOMINAL_RANGE else []
    )
    changed = _with_effects(sound, effects)
    sets_in = kind in (kinds.CHANGE_POINT, kinds.RAMP)
    first_day = FIRST_DAY + timedelta(days=int(random.integers(*MEASURED_AFTER_DAYS)))
    later = []
    for session, minutes in enumerate((*MEASURED_MINUTES, EXAM_MINUTES)):
        begin, changes = changed, []
        if sets_in and session <= onset_session:
            begin = sound
        if sets_in and session == onset_session:
            changes = [(onset_s, changed)]
            if kind == kinds.RAMP:
                changes = _ramp(sound, drawn[0], onset_s, 60.0 * minutes)
        start = first_day + timedelta(days=session, seconds=int(random.integers(8 * 3600)))
        later.append(
            Session(simulator, begin, tuple(changes), style_seed, int(random.integers(2**31)), minutes, start)
        )
    onset = Onset(later[onset_session].name, onset_s) if sets_in else None
    truth = Truth(
        number=number,
        simulator=simulator.name,
        kind=kind,
        style="other" if is_other else "same",
        n_joint=simulator.specification(machine.parameters).n_joint,
        effects=tuple(
            _true_effect(effect, one.size, onset) for effect, one in zip(effects, drawn, strict=True)
        ),
    )
    in_nominal: list[list[Effect]] = [[]] * len(NOMINAL_MINUTES)
    if kind == kinds.IN_NOMINAL:
        in_nominal = [effects] * len(NOMINAL_MINUTES)
    if kind == kinds.NOMINAL_RANGE:  # the first sessions carry nothing, the last one all of it
        in_nominal = [*in_nominal[1:], _payload(machine, 1.0)]
    n_measured = len(MEASURED_MINUTES)
    without = tuple(_with_effects(sound, [*effects[:i], *effects[i + 1 :]]) for i in range(len(effects)))
    largest = tuple(simulator.largest_size[one.kind] for one in drawn)
    strongest = tuple(
        one.at(most).apply(other) for one, other, most in zip(drawn, without, largest, strict=True)
    )
    nominal = _nominal_sessions(machine, in_nominal)
    return Plan(
        nominal, tuple(later[:n_measured]), tuple(later[n_measured:]), truth, without, strongest, largest
    )


def _size(random: np.random.Generator, largest: float) -> float:
    return float(largest * SMALLEST_SHARE ** random.random())


def _payload(of: Variant, share: float) -> list[Effect]:
    """Carried by a machine that has no fault: at most `LOAD_SHARE` of the heaviest."""
    size = LOAD_SHARE * of.simulator.largest_size[LOAD] * max(share, SMALLEST_SHARE)
    return [of.simulator.draw_effect(LOAD, of.style_seed, of, size)]


def _with_effects(machine: Machine, effects: Sequence[Effect]) -> Machine:
    for effect in effects:
        machine = effect.apply(machine)
    return machine


def _ramp(sound: Machine, drawn: Drawn, onset_s: float, end_s: float) -> list[tuple[float, Machine]]:
    """An effect that grows from nothing at the onset to its size at the session's end."""
    times = np.arange(onset_s, end_s, RAMP_STEP_S)
    shares = (np.arange(len(times)) + 1.0) / len(times)
    return [
        (float(t), drawn.at(float(share) * drawn.size).apply(sound))
        for t, share in zip(times, shares, strict=True)
    ]


def _nominal_sessions(of: Variant, present: Sequence[Sequence[Effect]]) -> tuple[Session, ...]:
    """What a baseline is identified from, with effects that are `present` even there, by session."""
    rows = zip(present, of.session_seeds, NOMINAL_MINUTES, strict=True)
    return tuple(
        Session(
            of.simulator,
            _with_effects(of.parameters, effects),
            (),
            of.style_seed,
            seed,
            minutes,
            FIRST_DAY + timedelta(days=day),
        )
        for day, (effects, seed, minutes) in enumerate(rows)
    )


def _true_effect(effect: Effect, size: float, onset: Onset | None) -> TrueEffect:
    return TrueEffect(
        family=effect.family if onset is None else kinds.CHANGE_POINT,
        of=None if onset is None else effect.family,
        kind=effect.kind,
        joints=effect.joints,
        depends_on=effect.depends_on,
        parameters={
            name: {"value": float(quantity.value), "unit": quantity.unit}
            for name, quantity in effect.truth.items()
        },
        onset=onset,
        cause=effect.cause,
        size=size,
    )
