"""One solution against its truth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.dependence import Dependence, judge_dependence
from benchmarks.closed_loop.losing_step import losing_step
from benchmarks.closed_loop.parameter_errors import (
    ParameterError,
    numbers_of,
    parameter_errors,
    sign_is_right,
)
from benchmarks.closed_loop.truth import TrueEffect, Truth

OTHER = "other"
FAILED = "failed"
AMBIGUOUS, OUTSIDE_CATALOGUE, NAMED = "ambiguous", "outside_catalogue", "named"
TIMES = ("time_since_start", "absolute_time")
LITTLE_AVOIDABLE = 0.1  # of the squared error: a share of less says nothing


@dataclass(frozen=True)
class Solution:
    """What is there of a case: None for what a run did not write."""

    status: int | str
    seconds: float
    answer: Mapping[str, Any] | None  # closed_loop.json
    exam: Mapping[str, Mapping[str, float]] | None  # errors before and after, by joint


@dataclass(frozen=True)
class Outcome:
    """How a case went. Counts are of true effects, so that those of pairs and triples count each.

    Attributes:
        case: Its name.
        truth: What the seal holds.
        verdict: As reported, or `failed`.
        detected: As reported; a run that failed detected nothing.
        named: Labels of the reported effects, strongest first.
        first: Label of what was named first, or the verdict where nothing was.
        hits: Per true effect, whether it was named first (of several: among as many), on one of its joints at least.
        half_hits: How many that stand among equivalent explanations instead.
        wrong_name: Whether a family that is not true, or true of other joints alone, was named with certainty.
        dependence: Of cases outside the catalogue for which `other` was reported.
        joints: True positives, false positives, false negatives.
        parameters: Of effects whose family was found.
        n_not_told: How many numbers the truth states of effects whose family was not found.
        signs: Whether direction or side is right, of effects that have one.
        onset_error_s: Of a change point in the right trajectory; infinite in the wrong one, and where none was told.
        before: 4 s error on the exam logs, RMS over the affected joints, rad.
        after: The same with the effects found.
        reduction: Mean over the affected joints of 1 - after / before.
        avoided: Share of the avoidable squared error that is gone.
        beats: Whether the error is lower than that of each baseline that was fitted, as the solution itself reports.
        evidence: For any effect: the more, the surer; what a receiver operating characteristic is drawn over.
        lost: Per true effect the step that lost it, None for those that count as hits; see `losing_step.py`.
        seconds: Run time.
    """

    case: str
    truth: Truth
    verdict: str
    detected: bool | None
    named: tuple[str, ...]
    first: str
    hits: tuple[bool, ...]
    half_hits: int
    wrong_name: bool
    dependence: Dependence | None
    joints: tuple[int, int, int]
    parameters: tuple[ParameterError, ...]
    n_not_told: int
    signs: tuple[bool, ...]
    onset_error_s: float | None
    before: float | None
    after: float | None
    reduction: float | None
    avoided: float | None
    beats: Mapping[str, bool]
    evidence: float
    lost: tuple[str | None, ...]
    seconds: float

    @property
    def is_visible(self) -> bool:
        """Whether an effect of the case can be seen; a case without effect counts as such."""
        return not self.truth.effects or any(effect.is_visible for effect in self.truth.effects)


def true_label(effect: TrueEffect) -> str:
    """The family as it is to be reported."""
    return f"{kinds.CHANGE_POINT} of {effect.of}" if effect.family == kinds.CHANGE_POINT else effect.family


def reported_label(effect: Mapping[str, Any]) -> str:
    """The family as it was reported."""
    family = str(effect["family"])
    return f"{family} of {effect.get('of')}" if family == kinds.CHANGE_POINT else family


def compare(case: str, truth: Truth, solution: Solution) -> Outcome:
    """Score one solution.

    Args:
        case: Its name.
        truth: From its seal.
        solution: What the run left.
    """
    answer: Mapping[str, Any] = solution.answer or {"verdict": FAILED, "detected": False, "effects": []}
    reported: Sequence[Mapping[str, Any]] = answer.get("effects") or []
    verdict = str(answer["verdict"])
    labels = [reported_label(effect) for effect in reported]
    dependence = _dependence(truth, reported)
    hit, half = _hits(truth, answer, reported, dependence)
    true_joints = {joint for effect in truth.effects for joint in effect.joints}
    told_joints = {joint for effect in reported for joint in effect.get("joints", ())}
    parameters, n_not_told, signs, onset_error_s = _numbers(truth, reported, labels)
    before, after, reduction = _exam(solution.exam, true_joints)
    floors = _at(answer, "baselines", "nominal_floor", "open_loop_rmse_80")
    return Outcome(
        case=case,
        truth=truth,
        verdict=verdict,
        detected=answer["detected"],
        named=tuple(labels),
        first=labels[0] if labels else verdict,
        hits=hit,
        half_hits=half,
        wrong_name=_is_wrong_name(truth, reported),
        dependence=dependence,
        joints=(
            len(true_joints & told_joints),
            len(told_joints - true_joints),
            len(true_joints - told_joints),
        ),
        parameters=tuple(parameters),
        n_not_told=n_not_told,
        signs=tuple(signs),
        onset_error_s=onset_error_s,
        before=before,
        after=after,
        reduction=reduction,
        avoided=_avoided(solution.exam, floors, true_joints),
        beats=_beats(answer, true_joints),
        evidence=evidence(answer),
        lost=tuple(
            None if is_hit else losing_step(effect, answer, _is_of)
            for effect, is_hit in zip(truth.effects, hit, strict=True)
        ),
        seconds=solution.seconds,
    )


def evidence(answer: Mapping[str, Any]) -> float:
    """What the answer says for any effect: the largest e-value that confirmation rows gave, if it was refused, too.

    Less than any where the search chose nothing.
    """
    chosen = (answer.get("trace") or {}).get("chosen") or []
    return max((float(of["e_value"]) for of in chosen), default=-math.inf)


def _is_of(reported: Mapping[str, Any], effect: TrueEffect) -> bool:
    """Whether a reported effect is the true one: of its family, on one of its joints at least."""
    joints = reported.get("joints")
    meets = joints is None or bool(set(joints) & set(effect.joints))
    return meets and reported_label(reported) == true_label(effect)


def _is_ramp_of(reported: Mapping[str, Any], effect: TrueEffect) -> bool:
    """Whether a ramp is told as a dependence on time, which is right, too."""
    on_time = any(entry.partition(":")[0] in TIMES for entry in reported.get("depends_on") or ())
    return on_time and bool(set(reported.get("joints", ())) & set(effect.joints))


def _hits(
    truth: Truth,
    answer: Mapping[str, Any],
    reported: Sequence[Mapping[str, Any]],
    dependence: Dependence | None,
) -> tuple[tuple[bool, ...], int]:
    """Per true effect whether it was named first; how many others stand among equivalent explanations."""
    first = list(reported[: len(truth.effects)])
    equivalent = [
        alternative for alternative in answer.get("alternatives") or [] if alternative.get("equivalent")
    ]
    if answer["verdict"] == AMBIGUOUS and first:
        equivalent.append(first.pop(0))
    hits, half = [], 0
    for effect in truth.effects:
        is_right = effect.family != OTHER or dependence == Dependence.right
        named = any(_is_of(told, effect) for told in first)
        named |= truth.kind == kinds.RAMP and any(_is_ramp_of(told, effect) for told in first)
        hits.append(is_right and named)
        if not hits[-1] and answer["verdict"] == AMBIGUOUS:
            half += any(_is_of(told, effect) for told in equivalent)
    return tuple(hits), half


def _is_wrong_name(truth: Truth, reported: Sequence[Mapping[str, Any]]) -> bool:
    """Whether a family other than the true ones was named with certainty. `other` names none."""
    return any(
        told.get("certain") is True
        and told["family"] != OTHER
        and not any(_is_of(told, effect) for effect in truth.effects)
        and not (truth.kind == kinds.RAMP and _is_ramp_of(told, truth.effects[0]))
        for told in reported
    )


def _dependence(truth: Truth, reported: Sequence[Mapping[str, Any]]) -> Dependence | None:
    """Of the first effect, where truth and report are both outside the catalogue."""
    if (
        not truth.effects
        or truth.effects[0].family != OTHER
        or not reported
        or reported[0]["family"] != OTHER
    ):
        return None
    true = truth.effects[0]
    return judge_dependence(true.depends_on, reported[0].get("depends_on") or [], true.joints)


def _numbers(
    truth: Truth, reported: Sequence[Mapping[str, Any]], labels: Sequence[str]
) -> tuple[list[ParameterError], int, list[bool], float | None]:
    """Parameters, how many are of effects that were not reported, signs, and onset."""
    errors: list[ParameterError] = []
    n_not_told = 0
    signs: list[bool] = []
    onset_error_s = None
    for effect in truth.effects:
        if true_label(effect) not in labels:
            n_not_told += len(numbers_of(effect.of or effect.family, effect.parameters))
            onset_error_s = math.inf if effect.onset is not None else onset_error_s
            continue
        found = reported[labels.index(true_label(effect))]
        arguments = (effect.of or effect.family, effect.parameters, found.get("parameters") or {})
        errors += parameter_errors(*arguments)
        sign = sign_is_right(*arguments)
        signs += [] if sign is None else [sign]
        if effect.onset is not None:
            told = found.get("onset") or {}
            same = told.get("trajectory") == effect.onset.trajectory
            onset_error_s = abs(float(told["t"]) - effect.onset.t) if same else math.inf
    return errors, n_not_told, signs, onset_error_s


def _exam(
    exam: Mapping[str, Mapping[str, float]] | None, joints: set[str]
) -> tuple[float | None, float | None, float | None]:
    if exam is None or not joints:
        return None, None, None
    before, after = exam["before"], exam["after"]
    reduction = sum(1.0 - after[joint] / before[joint] for joint in joints) / len(joints)
    return _root_mean_square(before, joints), _root_mean_square(after, joints), reduction


def _root_mean_square(errors: Mapping[str, float], joints: set[str]) -> float:
    return math.sqrt(sum(errors[joint] ** 2 for joint in joints) / len(joints))


def _avoided(
    exam: Mapping[str, Mapping[str, float]] | None, floor: Mapping[str, float] | None, joints: set[str]
) -> float | None:
    if exam is None or not floor or not joints:
        return None
    before, after, least = (
        sum(errors[joint] ** 2 for joint in joints) for errors in (exam["before"], exam["after"], floor)
    )
    if before - least < LITTLE_AVOIDABLE * before:
        return None
    return (before - after) / (before - least)


def _beats(answer: Mapping[str, Any], joints: set[str]) -> dict[str, bool]:
    """By baseline, whether the mean logarithm of the affected joints' errors is lower."""
    after = _at(answer, "error", "open_loop_rmse_80", "after")
    result: dict[str, bool] = {}
    for name in ("blackbox_residual", "finetune"):
        baseline = _at(answer, "baselines", name, "open_loop_rmse_80")
        if joints and after and baseline:  # they are fitted only when asked for
            result[name] = sum(math.log(after[j] / baseline[j]) for j in joints) < 0.0
    return result


def _at(content: Any, *path: str) -> Any:
    """The value at a path of keys, None where one is missing."""
    for key in path:
        content = content.get(key) if isinstance(content, Mapping) else None
    return content
