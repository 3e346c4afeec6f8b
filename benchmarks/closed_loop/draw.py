"""Cases drawn by seed: which effects, how large, who drives, and the sessions that result.

Everything follows from simulator, kind, seed and variant. Sizes are the kind's own (size 1) unless a calibration is
given.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import lru_cache
from zlib import crc32

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.machines import FIRST_DAY, N_VARIANT, NOMINAL_MINUTES, Variant, variant
from benchmarks.closed_loop.sessions import Session, trajectories
from benchmarks.closed_loop.simulator import Effect, Machine, Simulator
from benchmarks.closed_loop.simulators import PLANT
from benchmarks.closed_loop.truth import Onset, TrueEffect, Truth
from pipeline.errors import InputError
from pipeline.logs.tuples import Trajectory

MEASURED_MINUTES = (6.0, 6.0)
EXAM_MINUTES = 6.0
ONSET_SHARE = (0.3, 0.7)  # of the measured session in which an effect sets in
MEASURED_AFTER_DAYS = (20, 200)
OTHER_STYLE = 0.5  # probability
N_DRAW = 6  # of an effect that cannot be made as strong as wanted
LARGEST_SHORTFALL = (
    0.5  # in the growth of the error; more of it is taken where the ratio is still well in the range
)
ENOUGH_RATIO = 1.4


@dataclass(frozen=True)
class Size:
    """How strong an effect is drawn, and what 4 s error ratio that makes."""

    size: float
    wanted_ratio: float | None = None
    ratio: float | None = None

    @property
    def shortfall(self) -> float:
        """How far the growth of the error stays behind the wanted one, relative; 0 where it was not measured."""
        if self.wanted_ratio is None or self.ratio is None:
            return 0.0
        return max(1.0 - (self.ratio - 1.0) / (self.wanted_ratio - 1.0), 0.0)


Calibrate = Callable[[Variant, str, int, float, bool], Size]
"""(variant, kind of effect, its seed, a uniform draw in [0, 1) of the wanted ratio, half size) -> size."""


def plain(machine: Variant, kind: str, seed: int, share: float, half: bool) -> Size:
    """Size 1, or 0.5, without regard to errors."""
    return Size(0.5 if half else 1.0)


@dataclass(frozen=True)
class Plan:
    """A case before it is recorded."""

    nominal: tuple[Session, ...]
    measured: tuple[Session, ...]
    exam: tuple[Session, ...]
    truth: Truth


@dataclass(frozen=True)
class Case:
    """A recorded case in memory, as ingest would give its bags."""

    nominal: list[Trajectory]
    measured: list[Trajectory]
    exam: list[Trajectory]
    truth: Truth


def draw_case(
    kind: str, seed: int, variant_number: int, calibrate: Calibrate = plain, simulator: Simulator = PLANT
) -> Case:
    """Draw a case and record it in memory; see `draw_plan`."""
    plan = draw_plan(kind, seed, variant_number, calibrate, simulator)
    is_sound = kind != kinds.IN_NOMINAL
    nominal = list(_sound_nominal(simulator, variant_number)) if is_sound else _recorded(plan.nominal)
    return Case(nominal, _recorded(plan.measured), _recorded(plan.exam), plan.truth)


@lru_cache(maxsize=N_VARIANT)
def _sound_nominal(simulator: Simulator, variant_number: int) -> tuple[Trajectory, ...]:
    """A variant's nominal trajectories, kept: recording them takes longer than the rest of a case."""
    return tuple(_recorded(nominal_sessions(variant(simulator, variant_number))))


def _recorded(sessions: Sequence[Session]) -> list[Trajectory]:
    return [trajectory for session in sessions for trajectory in trajectories(session)]


def draw_plan(
    kind: str, seed: int, variant_number: int, calibrate: Calibrate = plain, simulator: Simulator = PLANT
) -> Plan:
    """Draw a case: effects, operator and sessions.

    Args:
        kind: One of the simulator's, `kinds.in_order`.
        seed: Of everything that belongs to the case.
        variant_number: The machine.
        calibrate: Chooses sizes.
        simulator: Which it is drawn from.

    Raises:
        InputError: There is no such kind.
    """
    known = kinds.in_order(simulator.outside)
    if kind not in known:
        raise InputError(
            f"kind {kind!r} is not known to the simulator {simulator.name}; choose one of {', '.join(known)}"
        )
    random = np.random.default_rng([seed, crc32(kind.encode()), variant_number, *simulator.entropy])
    machine = variant(simulator, variant_number)
    drawn = [
        _draw_effect(random, machine, of, calibrate, kind == kinds.HALF) for of in _effect_kinds(random, kind)
    ]
    is_other = random.random() < OTHER_STYLE
    style_seed = int(random.integers(2**31)) if is_other else machine.style_seed
    onset_session = int(random.integers(len(MEASURED_MINUTES)))
    onset_s = random.uniform(*ONSET_SHARE) * 60.0 * MEASURED_MINUTES[onset_session]
    changed = [effect for effect, _ in drawn]
    sets_in = kind == kinds.CHANGE_POINT
    if not sets_in:
        onset_session = 0
    first_day = FIRST_DAY + timedelta(days=int(random.integers(*MEASURED_AFTER_DAYS)))
    later = []
    for number, minutes in enumerate((*MEASURED_MINUTES, EXAM_MINUTES)):
        begin, changes = _parameters(
            machine.parameters, changed, onset_s if sets_in else None, number - onset_session
        )
        start = _moment(random, first_day + timedelta(days=number))
        later.append(
            Session(simulator, begin, changes, style_seed, int(random.integers(2**31)), minutes, start)
        )
    in_nominal = changed if kind == kinds.IN_NOMINAL else []
    onset = Onset(later[onset_session].name, onset_s) if sets_in else None
    truth = Truth(
        seed=seed,
        kind=kind,
        variant=variant_number,
        style="other" if is_other else "same",
        effects=tuple(_true_effect(effect, size, onset) for effect, size in drawn),
        simulator=simulator.name,
    )
    measured, exam = tuple(later[: len(MEASURED_MINUTES)]), tuple(later[len(MEASURED_MINUTES) :])
    return Plan(nominal_sessions(machine, in_nominal), measured, exam, truth)


def nominal_sessions(machine: Variant, present: list[Effect] | None = None) -> tuple[Session, ...]:
    """The sessions that a variant's baseline is identified from, with effects that are `present` even there."""
    begin, changes = _parameters(machine.parameters, present or [], None, 0)
    return tuple(
        Session(
            machine.simulator,
            begin,
            changes,
            machine.style_seed,
            seed,
            minutes,
            FIRST_DAY + timedelta(days=number),
        )
        for number, (seed, minutes) in enumerate(zip(machine.session_seeds, NOMINAL_MINUTES, strict=True))
    )


def _effect_kinds(random: np.random.Generator, kind: str) -> list[str]:
    """The simulator's kinds of effects that a case of `kind` has."""
    if kind == kinds.NULL:
        return []
    if kind == kinds.PAIR:
        return random.choice(kinds.FAMILIES, 2, replace=False).tolist()
    if kind == kinds.CHANGE_POINT:
        return [str(random.choice(kinds.SETS_IN))]
    if kind == kinds.IN_NOMINAL:
        return ["thermal_drift"]
    if kind == kinds.HALF:
        return [str(random.choice(kinds.FAMILIES))]
    return [kind]


def _draw_effect(
    random: np.random.Generator, machine: Variant, kind: str, calibrate: Calibrate, half: bool
) -> tuple[Effect, Size]:
    """An effect of the wanted size; one that cannot reach it (on a limit that is never met, say) is drawn anew."""
    share = random.random()
    tried = []
    for effect_seed in random.integers(2**31, size=N_DRAW).tolist():
        size = calibrate(machine, kind, effect_seed, share, half)
        tried.append((effect_seed, size))
        if size.shortfall < LARGEST_SHORTFALL or (size.ratio or 0.0) > ENOUGH_RATIO:
            break
    effect_seed, size = min(tried, key=lambda trial: trial[1].shortfall)
    return machine.simulator.draw_effect(kind, effect_seed, machine, size.size), size


def _parameters(
    sound: Machine, changed: Sequence[Effect], onset_s: float | None, session: int
) -> tuple[Machine, tuple[tuple[float, Machine], ...]]:
    """A session's machine at the start, and later ones with their times, s.

    Args:
        sound: The machine without effects.
        changed: Effects.
        onset_s: When they set in during session 0; None if they are there from its start.
        session: Number of the session, counted from the one in which effects set in; before it there are none.
    """
    parameters = sound
    for effect in changed:
        parameters = effect.apply(parameters)
    if session < 0:
        return sound, ()
    if session == 0 and onset_s is not None:
        return sound, ((onset_s, parameters),)
    return parameters, ()


def _moment(random: np.random.Generator, day: datetime) -> datetime:
    """Some moment of the working day."""
    return day + timedelta(seconds=int(random.integers(8 * 3600)))


def _true_effect(effect: Effect, size: Size, onset: Onset | None) -> TrueEffect:
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
        size=size.size,
        wanted_ratio=size.wanted_ratio,
        ratio=size.ratio,
    )
