"""The figures of the goals: what counts, over which cases, against which goal; of one simulator at a time."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.comparison import OTHER, Outcome
from benchmarks.closed_loop.dependence import Dependence
from benchmarks.closed_loop.intervals import over_machines, share_interval
from benchmarks.closed_loop.simulators import OUTSIDE

FALSE_ALARMS = (0.0, 0.02, 0.05, 0.1, 0.2)  # shares of the cases without effect, at which detection is told


@dataclass(frozen=True)
class Figure:
    """One line of the goals' table.

    Attributes:
        name: What is measured.
        goal: In words; empty for what stands there for information.
        value: None where there are no cases.
        n: Number of what was counted.
        interval: 95 %, over machines; None where there is none.
        met: Whether the measured value meets the goal; None without goal or cases.
        is_share: Whether the value is to be written in percent.
    """

    name: str
    goal: str
    value: float | None
    n: int
    interval: tuple[float, float] | None
    met: bool | None
    is_share: bool = True


Test = Callable[[float], bool]


def figures(outcomes: Sequence[Outcome], only_visible: bool) -> list[Figure]:
    """All lines of the goals' table.

    Args:
        outcomes: Of one simulator's cases.
        only_visible: Whether effects below the visible size are left out.
    """
    null = [o for o in outcomes if not o.truth.effects]
    full = [o for o in outcomes if o.truth.effects and (o.is_visible or not only_visible)]
    outside = [o for o in full if o.truth.kind in OUTSIDE]
    inside = [o for o in full if o.truth.kind not in OUTSIDE]
    of_kind = {kind: [o for o in inside if o.truth.kind == kind] for kind in (kinds.CHANGE_POINT, kinds.RAMP)}
    several = [o for o in inside if o.truth.kind in kinds.N_EFFECT]
    in_nominal = [o for o in inside if o.truth.kind == kinds.IN_NOMINAL]
    right = [_hits(o, only_visible) for o in inside]
    return [
        _share("detected", "≥ 95 %", _each(full, _is_detected), lambda x: x >= 0.95),
        _share("alarms without effect", "≤ 5 %", _each(null, _is_detected), lambda x: x <= 0.05),
        _share("right family first", "≥ 85 %", right, lambda x: x >= 0.85),
        _share("– of two or three at once", "", [_hits(o, only_visible) for o in several]),
        _share("– of ramps", "", [_hits(o, only_visible) for o in of_kind[kinds.RAMP]]),
        _share("– of what nominal logs show, too", "", [_hits(o, only_visible) for o in in_nominal]),
        _share("– among equivalents instead", "", _each(inside, lambda o: o.half_hits > 0)),
        _share(
            "wrong family with certainty", "≤ 2 %", _each(full, lambda o: o.wrong_name), lambda x: x <= 0.02
        ),
        _share(
            "change points detected",
            "≥ 85 %",
            _each(of_kind[kinds.CHANGE_POINT], _is_detected),
            lambda x: x >= 0.85,
        ),
        _share(
            "outside the catalogue: detected", "≥ 85 %", _each(outside, _is_detected), lambda x: x >= 0.85
        ),
        _share("– right dependence", "≥ 75 %", _each(outside, _depends_right), lambda x: x >= 0.75),
        _f1("joints, F1", full),
        *_parameters(inside),
        *_errors(full),
        _median("run time, s", "", [[o.seconds] for o in outcomes], is_share=False),
    ]


def roc(outcomes: Sequence[Outcome], only_visible: bool) -> tuple[list[float], float]:
    """Receiver operating characteristic over the evidence that answers give.

    Returns:
        Detection at the shares `FALSE_ALARMS` of the cases without effect, and the area below the curve; NaN where
        cases of either sort are missing.
    """
    null = np.array([o.evidence for o in outcomes if not o.truth.effects])
    full = np.array([o.evidence for o in outcomes if o.truth.effects and (o.is_visible or not only_visible)])
    if not len(null) or not len(full):
        return [math.nan] * len(FALSE_ALARMS), math.nan
    highest = np.sort(null)[::-1]
    thresholds = [highest[min(int(share * len(null)), len(null) - 1)] for share in FALSE_ALARMS]
    area = np.mean((full[:, None] > null) + 0.5 * (full[:, None] == null))
    return [float(np.mean(full > threshold)) for threshold in thresholds], float(area)


def _is_detected(o: Outcome) -> bool:
    return o.detected is True


def _depends_right(o: Outcome) -> bool:
    return o.dependence == Dependence.right and o.first == OTHER


def _each(outcomes: Sequence[Outcome], test: Callable[[Outcome], bool]) -> list[list[bool]]:
    return [[test(o)] for o in outcomes]


def _hits(o: Outcome, only_visible: bool) -> list[bool]:
    pairs = zip(o.truth.effects, o.hits, strict=True)
    return [hit for effect, hit in pairs if effect.is_visible or not only_visible]


def _f1(name: str, scored: Sequence[Outcome]) -> Figure:
    true, false, missed = np.sum([o.joints for o in scored], axis=0) if scored else (0, 0, 0)
    value = float(2 * true / (2 * true + false + missed)) if true + false + missed else None
    return Figure(name, "", value, len(scored), None, None, is_share=False)


def _parameters(inside: Sequence[Outcome]) -> list[Figure]:
    relative = [[p.relative for p in o.parameters if p.relative is not None] for o in inside]
    onsets = [[o.onset_error_s] for o in inside if o.onset_error_s is not None]
    return [
        _median("parameters: relative error, median", "", relative),
        _share("– 95 % intervals that cover", "", [[p.covered for p in o.parameters] for o in inside]),
        _share("– direction or side right", "", [o.signs for o in inside]),
        _median("– onset: error, median, s", "", onsets, is_share=False),
    ]


def _errors(full: Sequence[Outcome]) -> list[Figure]:
    reductions = [[o.reduction] for o in full if o.reduction is not None]
    avoided = [[o.avoided] for o in full if o.avoided is not None]
    beaten = [
        _share(f"lower error than {name}", "", [[o.beats[name]] for o in full if name in o.beats])
        for name in ("blackbox_residual", "finetune")
    ]
    return [
        _median("4 s error on exam logs: reduction, median", "", reductions),
        _median("– of what can be avoided, squared", "", avoided),
        *[figure for figure in beaten if figure.n],
    ]


def _share(name: str, goal: str, hits: Sequence[Sequence[bool]], test: Test | None = None) -> Figure:
    flat = [hit for of in hits for hit in of]
    if not flat:
        return Figure(name, goal, None, 0, None, None)
    value = sum(flat) / len(flat)
    return Figure(name, goal, value, len(flat), share_interval(hits), test(value) if test else None)


def _median(name: str, goal: str, values: Iterable[Sequence[float]], is_share: bool = True) -> Figure:
    groups = [of for of in values if len(of)]
    flat = [value for of in groups for value in of]
    if not flat:
        return Figure(name, goal, None, 0, None, None, is_share)
    interval = over_machines(groups, lambda drawn: float(np.median(drawn)))
    return Figure(name, goal, float(np.median(flat)), len(flat), interval, None, is_share)
