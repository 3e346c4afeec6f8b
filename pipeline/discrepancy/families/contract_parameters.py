"""From a candidate's values to the parameters that the contract names (section 4), with 95 % intervals."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pipeline.discrepancy.families.shared_flow import coefficients_by_source
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.draws import OF_95_PERCENT
from pipeline.effects.effect import Effect

Quantity = dict[str, Any]

# Parameters that have a sign; no other is below zero on any machine.
SIGNED = {"added_time_constant", "added_time_constant_starting", "cold_speed_loss", "offset", "sag_rate"}

WIDEST = "widest"  # of a quantity under way: what `Spread` says


class Spread(NamedTuple):
    """How far a value may be off.

    Attributes:
        deviation: Standard deviation by what the rows say.
        widest: Standard deviation of any plausible value, as if the rows said nothing.
    """

    deviation: float
    widest: float


UNKNOWN = Spread(0.0, np.inf)


def describe(
    candidate: Candidate,
    effect: Effect,
    spread: Mapping[str, Spread],
    joints: Sequence[str],
    unit: str,
) -> dict[str, Quantity]:
    """Parameters of one effect on one joint.

    Args:
        spread: Per point's name, and `coefficient:<index>`.
        joints: All joints' names.
        unit: `rad` or `m`.
    """
    if candidate.family in DEPENDENCES:
        return {}

    def of(value: float, unit: str, name: str, factor: float = 1.0) -> Quantity:
        deviation, widest = spread.get(name, UNKNOWN)
        return quantity(value, unit, abs(factor) * deviation, abs(factor) * widest)

    units, told = units_of(unit), {}
    for parameter in effect.card.parameters:
        name, index = parameter.name, candidate.index_of(parameter.name)
        value, place = candidate.point.get(name, parameter.neutral), name
        if index is not None:
            value, place = parameter.neutral + float(candidate.coefficients[index]), f"coefficient:{index}"
        elif not parameter.grid and name not in candidate.point:
            continue
        if not parameter.per_source:
            told[name] = of(value, units.get(parameter.unit, parameter.unit), place)
    span = float(np.ptp([effect.setting.lower[candidate.joint], effect.setting.upper[candidate.joint]]))
    return _as_in_the_contract(candidate, told, of, joints, (span, unit))


def _as_in_the_contract(
    candidate: Candidate,
    told: dict[str, Quantity],
    of: Callable[..., Quantity],
    joints: Sequence[str],
    range_: tuple[float, str],
) -> dict[str, Quantity]:
    """Values that the contract does not name as the card does; `range_` is the joint's, with its unit."""
    coefficients = candidate.coefficients
    match candidate.family:
        case "gain":
            freed = [name for one in candidate.freed for name, _ in one]
            direction = 0 if len(freed) == 2 else (1 if freed[0] == "ratio_positive" else -1)
            ratio = of(1.0 + float(np.mean(coefficients)), "1", "coefficient:0")
            by_way = {f"speed_{name}": value for name, value in told.items() if len(coefficients) == 2}
            return {"speed_ratio": ratio, "direction": {"value": direction, "unit": "sign"}, **by_way}
        case "flow_coupling":
            by_source = {
                f"loss_fraction_to:{joints[source]}": of(
                    float(coefficients[index]), "1", f"coefficient:{index}"
                )
                for source, index in coefficients_by_source(candidate).items()
            }
            losses = [(loss["value"], deviation_of(loss), loss[WIDEST]) for loss in by_source.values()]
            values, *spread = np.reshape(losses, (-1, 3)).T
            total = quantity(values.sum(), "1", *np.linalg.norm(spread, axis=1).tolist())
            return {"loss_fraction": total, **by_source, **told}
        case "thermal_drift":
            warm = 1.0 + candidate.coefficient_of("warm_gain")
            place = f"coefficient:{candidate.index_of('cold_speed_loss')}"
            loss = of(candidate.coefficient_of("cold_speed_loss") / warm, "1", place, 1.0 / warm)
            return {name: value for name, value in told.items() if name != "warm_gain"} | {
                "cold_speed_loss": loss
            }
        case "end_cushion":
            span, unit = range_
            return {
                "zone_length": of(candidate.point["zone_share"] * span, unit, "zone_share", span),
                "min_speed_ratio": of(1.0 - float(coefficients[0]), "1", "coefficient:0"),
                "side": {"value": 1 if candidate.freed[0][0][0] == "loss_upper" else -1, "unit": "sign"},
            }
        case "lag":
            return {**told, **_lag(candidate.point["fall_share"], told["added_time_constant"])}
    return told


def _lag(fall_share: float, starting: Quantity) -> dict[str, Quantity]:
    """Of a valve that closes within its overlap, and so stops sooner than it starts.

    It has one and the same time constant of its pilot: how far starts and stops bear that one out, speeds do not say.
    It is somewhere between what starts show and the mean of both, each as likely.
    """
    value, mean_share = starting["value"], 0.5 * (1.0 + fall_share)
    between = 0.5 * (1.0 + mean_share)
    unknown = abs(1.0 - mean_share) * abs(value) / np.sqrt(12.0)
    deviation = float(np.hypot(between * deviation_of(starting), unknown))
    return {
        "added_time_constant": quantity(between * value, "s", deviation, between * starting[WIDEST]),
        "added_time_constant_starting": starting,
    }


def quantity(value: float, unit: str, deviation: float, widest: float = np.inf) -> Quantity:
    """A value with its 95 % interval, and what `plausible` is to make of it."""
    return {
        "value": float(value),
        "unit": unit,
        "ci95": [float(value - OF_95_PERCENT * deviation), float(value + OF_95_PERCENT * deviation)],
        WIDEST: float(widest),
    }


def plausible(parameters: Mapping[str, Quantity]) -> dict[str, Quantity]:
    """Parameters, by `name` or `name:joint`, as the contract wants them: no interval holds what cannot be.

    What lies beyond a parameter's bounds is not plausible, whatever rows say that hardly show the value: a uniform
    prior. It is one prior of one value, so joints are averaged before.
    """
    result = {}
    for name, of in parameters.items():
        result[name] = {key: value for key, value in of.items() if key != WIDEST}
        if "ci95" not in of:
            continue
        half = OF_95_PERCENT * within_plausible(deviation_of(of), float(of.get(WIDEST, np.inf)))
        ends = [float(of["value"]) - half, float(of["value"]) + half]
        result[name]["ci95"] = ends if name.partition(":")[0] in SIGNED else [max(end, 0.0) for end in ends]
    return result


def within_plausible(deviation: float, widest: float) -> float:
    """A standard deviation with what is plausible at all, of deviation `widest`, as prior; infinite: no prior."""
    if not np.isfinite(widest) or deviation <= 0.0:
        return deviation
    return 1.0 / float(np.hypot(1.0 / deviation, 1.0 / max(widest, 1e-12)))


def deviation_of(of: Mapping[str, Any]) -> float:
    """The standard deviation that `quantity` was given; 0 of a value that has no interval."""
    lower, upper = of.get("ci95", (0.0, 0.0))
    return (upper - lower) / (2.0 * OF_95_PERCENT)


def spreads(
    coordinates: Sequence[Coordinate],
    covariance: np.ndarray,
    number: int,
    candidate: Candidate,
    model_error: float,
) -> dict[str, Spread]:
    """How far one effect's values may be off: by sampling, and of the model that the effect is an idealisation of.

    Args:
        coordinates: Of the joint.
        covariance: Of the coordinates.
        number: Of the effect among those found.
        model_error: Share of a value by which the idealised effect may differ from the real one.
    """
    result = {}
    if candidate.deviation is not None:
        result = dict.fromkeys(candidate.point, Spread(candidate.deviation, np.inf))
    for index, coordinate in enumerate(coordinates):
        if coordinate.effect != number:
            continue
        name = coordinate.name or f"coefficient:{coordinate.index}"
        value = (
            candidate.point[coordinate.name] if coordinate.name else candidate.coefficients[coordinate.index]
        )
        deviation = float(np.hypot(np.sqrt(max(covariance[index, index], 0.0)), model_error * abs(value)))
        result[name] = Spread(deviation, float((coordinate.upper - coordinate.lower) / np.sqrt(12.0)))
    return result


def weighted_mean(values: np.ndarray, deviations: np.ndarray) -> tuple[float, float]:
    """One value of what several joints say, each weighted by its precision, and its standard deviation.

    Where they differ by more than their deviations allow, the deviation is widened until they do not; nor is it less
    than theirs in the mean, as what one model and one operator make joints off by may be common to all of them.
    Source: Birge (1932), The calculation of errors by the method of least squares.

    Args:
        values: (n,).
        deviations: (n,) standard deviations.
    """
    weights = 1.0 / np.maximum(deviations, 1e-3 * np.abs(values).max() + 1e-12) ** 2
    mean = float(weights @ values / weights.sum())
    chi_squared = float(weights @ (values - mean) ** 2) / max(len(values) - 1, 1)
    in_common = float(weights @ deviations / weights.sum())
    return mean, max(float(np.sqrt(max(chi_squared, 1.0) / weights.sum())), in_common)


def of_all_joints(described: Sequence[Mapping[str, Any]], joints: Sequence[str]) -> dict[str, Quantity]:
    """One effect's parameters on several joints: each by itself under `name:joint`, and their weighted mean.

    Args:
        described: Per joint, its parameters; not every joint has all of them.
        joints: Their names.
    """
    merged: dict[str, Quantity] = {}
    for name in dict.fromkeys(name for of_joint in described for name in of_joint):
        having = {
            joint: of_joint[name]
            for joint, of_joint in zip(joints, described, strict=True)
            if name in of_joint
        }
        values = np.array([of["value"] for of in having.values()], float)
        deviations = np.array([deviation_of(of) for of in having.values()])
        mean, deviation = weighted_mean(values, deviations)
        widest = max(float(of.get(WIDEST, np.inf)) for of in having.values())
        merged[name] = quantity(mean, next(iter(having.values()))["unit"], deviation, widest)
        merged |= {f"{name}:{joint}": of for joint, of in having.items()}
    return merged


def units_of(unit: str) -> dict[str, str]:
    """What a card's lengths and speeds are told in on a joint whose positions are in `rad` or `m`."""
    return {"length": unit, "speed": f"{unit}/s"}
