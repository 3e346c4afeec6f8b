"""From a candidate's values to the parameters that the contract names (section 4), with 95 % intervals."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from pipeline.discrepancy.families.shared_flow import coefficients_by_source
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.free_parameters import Coordinate
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.draws import OF_95_PERCENT
from pipeline.effects.effect import Effect

Quantity = dict[str, Any]

# Parameters that are not below zero on any machine; the others have a sign.
NOT_NEGATIVE = {
    "added_delay",
    "cold_lag",
    "correlation_time",
    "damping_ratio",
    "fall_share",
    "frequency",
    "lag_time_ratio",
    "latency",
    "loss_alone_negative",
    "loss_alone_positive",
    "loss_fraction",
    "loss_fraction_to",
    "mean_extra_time",
    "mean_extra_time_of_command",
    "mean_speed_ratio_down",
    "mean_speed_ratio_up",
    "min_speed_ratio",
    "rest_threshold",
    "rest_threshold_of_command",
    "scale",
    "share",
    "share_in_negative_motion",
    "share_in_positive_motion",
    "speed_ratio",
    "speed_ratio_negative",
    "speed_ratio_positive",
    "std_log_speed",
    "time_constant",
    "width",
    "zone_length",
}

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
        candidate: The effect.
        effect: Its wrapper.
        spread: Per point's name, and `coefficient:<index>`.
        joints: All joints' names.
        unit: `rad` or `m`.
    """
    point, coefficients = candidate.point, candidate.coefficients
    setting, joint = effect.setting, candidate.joint
    span = float(setting.upper[joint] - setting.lower[joint])
    family = candidate.family

    def of(value: float, unit: str, name: str, factor: float = 1.0) -> Quantity:
        deviation, widest = spread.get(name, UNKNOWN)
        return quantity(value, unit, abs(factor) * deviation, abs(factor) * widest)

    if family == "gain":
        freed = [name for one in candidate.freed for name, _ in one]
        direction = 0 if len(freed) == 2 else (1 if freed[0] == "ratio_positive" else -1)
        value = 1.0 + float(np.mean(coefficients))
        sign: Quantity = {"value": direction, "unit": "sign"}
        result = {"speed_ratio": of(value, "1", "coefficient:0"), "direction": sign}
        if len(coefficients) == 2:
            result["speed_ratio_positive"] = of(1.0 + float(coefficients[0]), "1", "coefficient:0")
            result["speed_ratio_negative"] = of(1.0 + float(coefficients[1]), "1", "coefficient:1")
        return result
    if family == "load":
        return {
            "mean_speed_ratio_up": of(1.0 + float(coefficients[0]), "1", "coefficient:0"),
            "mean_speed_ratio_down": of(1.0 + float(coefficients[1]), "1", "coefficient:1"),
        }
    if family == "flow_coupling":
        by_source = coefficients_by_source(candidate)
        result = {
            f"loss_fraction_to:{joints[source]}": of(float(coefficients[index]), "1", f"coefficient:{index}")
            for source, index in by_source.items()
        }
        for index, ((name, source), *_) in enumerate(candidate.freed):
            if source is None:  # by itself
                result[name] = of(float(coefficients[index]), "1", f"coefficient:{index}")
        indices = list(by_source.values())
        deviations = np.array([spread.get(f"coefficient:{index}", UNKNOWN) for index in indices]).reshape(
            -1, 2
        )
        total = quantity(
            float(coefficients[indices].sum()), "1", *np.linalg.norm(deviations, axis=0).tolist()
        )
        return {"loss_fraction": total, **result}
    if family == "thermal_drift":
        cold, lag = candidate.index_of("cold_speed_loss"), candidate.index_of("cold_lag")
        warm = 1.0 + candidate.coefficient_of("warm_gain")
        loss = candidate.coefficient_of("cold_speed_loss") / warm
        result = {
            "cold_speed_loss": of(loss, "1", f"coefficient:{cold}", 1.0 / warm),
            "time_constant": of(point["time_constant"], "s", "time_constant"),
        }
        if lag is not None:
            result["cold_lag"] = of(float(coefficients[lag]), "s", f"coefficient:{lag}")
        for name in ("fall_share", "lag_time_ratio"):
            if name in point:
                result[name] = of(point[name], "1", name)
        return result
    if family == "leakage":
        result = {"sag_rate": of(float(coefficients[0]), f"{unit}/s", "coefficient:0")}
        for index, one in enumerate(candidate.freed[1:], start=1):
            result[one[0][0]] = of(float(coefficients[index]), "1", f"coefficient:{index}")
        return result
    if family == "end_cushion":
        upper = candidate.freed[0][0][0] == "loss_upper"
        return {
            "zone_length": of(point["zone_share"] * span, unit, "zone_share", span),
            "min_speed_ratio": of(1.0 - float(coefficients[0]), "1", "coefficient:0"),
            "side": {"value": 1 if upper else -1, "unit": "sign"},
        }
    if family == "oscillation":
        return {
            "frequency": of(point["frequency"], "Hz", "frequency"),
            "damping_ratio": of(point["damping_ratio"], "1", "damping_ratio"),
            "share": of(float(coefficients[0]), "1", "coefficient:0"),
        }
    if family == "sensor_bias":
        return {
            "offset": of(point.get("offset", 0.0), unit, "offset"),
            "scale": of(point.get("scale", 1.0), "1", "scale"),
        }
    if family in DEPENDENCES:
        return {}
    if family == "lag":
        # A valve that closes within its overlap stops sooner than it starts, with one and the same time constant of its
        # pilot: how far starts and stops bear that one out, speeds do not say. It is somewhere between what starts
        # show and the mean of both, each as likely.
        starting = point["added_time_constant"]
        mean_share = 0.5 * (1.0 + point["fall_share"])
        between = 0.5 * (1.0 + mean_share)
        deviation, widest = spread.get("added_time_constant", UNKNOWN)
        unknown = abs(1.0 - mean_share) * abs(starting) / np.sqrt(12.0)
        return {
            "added_time_constant": quantity(
                between * starting, "s", float(np.hypot(between * deviation, unknown)), between * widest
            ),
            "added_time_constant_starting": of(starting, "s", "added_time_constant"),
            "fall_share": of(point["fall_share"], "1", "fall_share"),
        }
    units = {
        parameter.name: {"length": unit, "speed": f"{unit}/s"}.get(parameter.unit, parameter.unit)
        for parameter in effect.card.parameters
    }
    return {name: of(value, units[name], name) for name, value in point.items()}


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
        is_never_negative = name.partition(":")[0] in NOT_NEGATIVE
        result[name]["ci95"] = [max(end, 0.0) for end in ends] if is_never_negative else ends
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
        candidate: The effect.
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
