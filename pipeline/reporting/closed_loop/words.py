"""Effects, joints and dependences of `closed_loop.json` in words."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pipeline.reporting.closed_loop.quantities import estimate, number

Document = Mapping[str, Any]

FAMILY_NAMES = {
    "gain": "changed speed",
    "delay": "pure delay",
    "lag": "slower or faster response",
    "flow_coupling": "shared oil flow",
    "load": "load and gravity",
    "thermal_drift": "warming up",
    "supply_variation": "varying supply",
    "leakage": "creep without command",
    "backlash": "play on reversal",
    "stiction": "sticking after rest",
    "end_cushion": "cushion at the stop",
    "sensor_bias": "encoder offset or scale",
    "timing": "late measurements",
    "oscillation": "resonance",
    "change_point": "change during the logs",
    "other": "outside the catalogue",
}
_FORM_NAMES = {"other:dead_band": "dead band"}  # known forms of `other`
PARAMETER_NAMES = {
    "speed_ratio": "speed ratio, new to old",
    "ratio_positive": "speed ratio in the positive direction",
    "ratio_negative": "speed ratio in the negative direction",
    "direction": "direction (−1, 1; 0: both)",
    "loss_fraction": "share of speed lost at full demand",
    "mean_speed_ratio_up": "mean speed ratio going up",
    "mean_speed_ratio_down": "mean speed ratio going down",
    "cold_speed_loss": "share of speed lost when cold",
    "time_constant": "time constant of warming up",
    "std_log_speed": "standard deviation of the logarithm of speed",
    "rest_threshold": "rest after which it sticks",
    "mean_extra_time": "mean delay of the start",
    "min_speed_ratio": "smallest speed ratio",
    "side": "side (−1 lower limit, 1 upper limit)",
}
_SHORT_NAMES = {
    "speed_ratio": "speed ratio",
    "loss_fraction": "loss",
    "std_log_speed": "spread",
    "dead_band_negative": "mean band of negative commands",
    "dead_band_positive": "of positive ones",
    "saturation_negative": "mean saturation of negative commands",
    "saturation_positive": "of positive ones",
}
_SIZES = {  # parameters of sentences; the table lists the others
    "gain": ("speed_ratio",),
    "delay": ("added_delay",),
    "lag": ("added_time_constant",),
    "flow_coupling": ("loss_fraction",),
    "load": ("mean_speed_ratio_up", "mean_speed_ratio_down"),
    "thermal_drift": ("cold_speed_loss", "time_constant"),
    "supply_variation": ("std_log_speed", "correlation_time"),
    "leakage": ("sag_rate",),
    "backlash": ("width",),
    "stiction": ("mean_extra_time", "rest_threshold"),
    "end_cushion": ("zone_length", "min_speed_ratio"),
    "sensor_bias": ("offset", "scale"),
    "timing": ("latency",),
    "oscillation": ("frequency", "damping_ratio"),
}
_SIGNS = ("direction", "side")  # the sentence states these in words
_VARIABLES = {
    "command": ("the command", "the command of {joint}"),
    "command_history": ("earlier commands", "earlier commands of {joint}"),
    "hold_time": ("how long the command has been held", "how long the command of {joint} has been held"),
    "warmth": ("how long commands were held lately", "how long commands of {joint} were held lately"),
    "direction": ("the direction of motion", "the direction in which {joint} moves"),
    "position": ("position", "the position of {joint}"),
    "velocity": ("speed", "the speed of {joint}"),
    "reversal": ("reversals", "reversals of {joint}"),
    "rest_time": ("how long it has been at rest", "how long {joint} has been at rest"),
    "time_since_start": ("the time since the start of the log", "the time since the start of the log"),
    "time_since_stop": ("the time since the last stop", "the time since {joint} last stopped"),
    "absolute_time": ("time itself", "time itself"),
    "activity": ("how much work there was lately", "how much {joint} has worked lately"),
    "travel": ("how far it has moved altogether", "how far {joint} has moved altogether"),
    "zero_command": ("whether there is no command", "whether {joint} has no command"),
    "clock": ("the measurement's clock", "the clock of the measurements of {joint}"),
    "random": ("nothing that was measured (random)", "nothing that was measured (random, {joint})"),
    "channel": ("a measured channel", "{joint}, which is measured"),
    "latent": ("something unmeasured that all joints share", "something unmeasured that all joints share"),
}


def listed(words: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]


def joints_in_words(joints: Sequence[str]) -> str:
    """`the arm`, `the boom and the arm`."""
    return listed([f"the {joint}" for joint in joints]) if joints else "the machine"


def family_name(family: str) -> str:
    """The family's everyday name; `other:<variable>` names the dependence."""
    if family in _FORM_NAMES:
        return f"{_FORM_NAMES[family]} (outside the catalogue)"
    kind, _, variable = family.partition(":")
    name = FAMILY_NAMES.get(kind, kind.replace("_", " "))
    return f"{name}: depends on {dependence(variable)}" if variable else name


def short_family_name(family: str) -> str:
    """A shorter `family_name`: of a dependence, the variable alone."""
    variable = family.partition(":")[2]
    in_short = f"depends on {dependence(variable)}" if variable else family_name(family)
    return _FORM_NAMES.get(family, in_short)


def parameter_name(name: str) -> str:
    """The parameter's name in words, with the joint for `parameter:joint`."""
    parameter, _, joint = name.partition(":")
    words = PARAMETER_NAMES.get(parameter, parameter.replace("_", " "))
    return f"{words}, {joint}" if joint else words


def dependence(entry: str) -> str:
    """An entry `variable` or `variable:joint` of `depends_on` in words."""
    variable, _, joint = entry.partition(":")
    alone, of_joint = _VARIABLES.get(
        variable, (variable.replace("_", " "), f"{variable.replace('_', ' ')} of {{joint}}")
    )
    return of_joint.replace("{joint}", f"the {joint.replace('_', ' ')}") if joint else alone


def dependences(effect: Document) -> str:
    """All entries of `depends_on` in words."""
    return listed([dependence(entry) for entry in effect.get("depends_on") or []] or ["unknown"])


def other_joints(effect: Document) -> list[str]:
    """Other joints whose variables the effect depends on."""
    named = [entry.partition(":")[2] for entry in effect.get("depends_on") or []]
    return [name for name in dict.fromkeys(named) if name and name not in effect.get("joints", [])]


def sizes(effect: Document) -> list[str]:
    """The contract's parameters with their 95 % intervals, `speed ratio 0.75, 95 % 0.73 to 0.77`."""
    family = effect.get("of") if effect["family"] == "change_point" else effect["family"]
    given = {
        name: parameter
        for name, parameter in (effect.get("parameters") or {}).items()
        if isinstance(parameter, Mapping)
        and math.isfinite(number(parameter.get("value")))
        and name not in _SIGNS
    }
    chosen = [name for name in _SIZES.get(str(family), ()) if name in given] or [
        name for name in given if ":" not in name
    ][:2]
    texts = []
    for name in chosen:
        value, interval, unit = estimate(given[name])
        text = f"{_SHORT_NAMES.get(name, name.replace('_', ' '))} {value} {unit}".strip()
        texts.append(text + (f", 95 % {interval[0]} to {interval[1]}" if interval else ", no interval"))
    return texts
