"""How a machine differs from its model, as a clause per family of effects."""

import math
from collections.abc import Callable, Mapping

from pipeline.reporting.closed_loop.quantities import estimate, number, percent, with_unit
from pipeline.reporting.closed_loop.words import (
    Document,
    dependence,
    dependences,
    family_name,
    joints_in_words,
    listed,
    other_joints,
)

SAME_SPEED = 0.005  # a speed ratio this close to one is not called faster or slower


class Subject:
    """An effect as the subject of a sentence: verbs agree with the number of its joints."""

    def __init__(self, effect: Document) -> None:
        self.effect = effect
        self.plural = len(effect.get("joints") or []) > 1
        self.its, self.it = ("their", "they") if self.plural else ("its", "it")

    def verb(self, base: str) -> str:
        """`moves` or `move`."""
        return base if self.plural else {"have": "has"}.get(base, f"{base}s")

    def value(self, name: str) -> float:
        """A parameter's value; NaN if the document lacks it."""
        parameter = (self.effect.get("parameters") or {}).get(name)
        return number(parameter.get("value")) if isinstance(parameter, Mapping) else math.nan

    def amount(self, name: str, otherwise: str = "some time") -> str:
        """A parameter's value with its unit."""
        if not math.isfinite(self.value(name)):
            return otherwise
        parameter = self.effect["parameters"][name]
        return with_unit(estimate(parameter)[0], str(parameter.get("unit", "1")))


def clause(effect: Document) -> str:
    """How the machine differs from the model, as a main clause without its full stop."""
    joints = list(effect.get("joints") or [])
    family = str(effect["family"])
    if family == "change_point":
        family = str(effect.get("of") or family)
    family = family.partition(":")[0]
    predicate = _PREDICATES.get(family, lambda subject: f"{subject.verb('show')} {family_name(family)}")
    text = f"{joints_in_words(joints)} {predicate(Subject(effect))}"
    others = other_joints(effect)
    if others and family not in ("flow_coupling", "other"):
        entries = [entry for entry in effect["depends_on"] if entry.partition(":")[2] in others]
        text += f", depending on {listed([dependence(entry) for entry in entries])}"
    onset = effect.get("onset")
    return f"from {number(onset['t']):.0f} s into {onset['trajectory']} on, {text}" if onset else text


def _faster(ratio: float) -> str:
    if not math.isfinite(ratio):
        return "at another speed"
    if abs(ratio - 1) < SAME_SPEED:
        return "as fast"
    return f"{percent(abs(ratio - 1))} {'slower' if ratio < 1 else 'faster'}"


def _faster_by_joint(s: Subject, name: str) -> str:
    """From the slowest joint to the fastest, where the document tells them apart: their mean may hold for none."""
    own = [s.value(key) for key in s.effect.get("parameters") or {} if key.startswith(f"{name}:")] or [
        s.value(name)
    ]
    return " to ".join(dict.fromkeys(_faster(ratio) for ratio in (min(own), max(own))))


def _gain(s: Subject) -> str:
    direction = {1.0: "positive", -1.0: "negative"}.get(s.value("direction"))
    where = f" when {s.it} {s.verb('move')} in the {direction} direction" if direction else ""
    ratio = s.value("speed_ratio")
    return f"{s.verb('move')} {_faster(ratio)} {'as' if abs(ratio - 1) < SAME_SPEED else 'than'} the model{where}"


def _load(s: Subject) -> str:
    up, down = (_faster_by_joint(s, f"mean_speed_ratio_{way}") for way in ("up", "down"))
    if not any(math.isfinite(s.value(f"mean_speed_ratio_{way}")) for way in ("up", "down")):
        return f"{s.verb('move')} at a speed that depends on pose and load as the model does not know it"
    return f"{s.verb('move')} {up} going up and {down} going down, as under another load"


def _flow_coupling(s: Subject) -> str:
    loss, sources = s.value("loss_fraction"), other_joints(s.effect)
    lost = f"up to {percent(loss)} of {s.its} speed" if math.isfinite(loss) else "speed"
    drawing = joints_in_words(sources) if sources else "other joints"
    return f"{s.verb('lose')} {lost} while {drawing} {'draws' if len(sources) == 1 else 'draw'} on the same oil supply"


def _thermal_drift(s: Subject) -> str:
    cold = _faster(1 - s.value("cold_speed_loss"))
    return f"{s.verb('move')} {cold} right after the start and {s.verb('recover')} while the oil warms"


def _supply_variation(s: Subject) -> str:
    spread = percent(s.value("std_log_speed"))
    return f"{s.verb('change')} speed by some {spread} together, for no reason that was measured"


def _end_cushion(s: Subject) -> str:
    side = {1.0: "upper ", -1.0: "lower "}.get(s.value("side"), "")
    slowest = s.value("min_speed_ratio")
    to = f" to {percent(slowest)} of {s.its} speed" if math.isfinite(slowest) else ""
    return f"{s.verb('slow')} down{to} in the last {s.amount('zone_length', 'stretch')} before {s.its} {side}limit"


def _lag(s: Subject) -> str:
    how = "faster" if s.value("added_time_constant") < 0 else "more slowly"
    return f"{s.verb('build')} up and {s.verb('lose')} speed {how} than the model"


def _other(s: Subject) -> str:
    bands, full = (
        [s.value(name) for name in s.effect.get("parameters") or {} if name.startswith(start)]
        for start in ("dead_band", "saturation")
    )
    if bands and full:
        return (
            f"{s.verb('leave')} small commands unanswered that move the model, as behind dead bands of "
            f"{percent(min(bands))} to {percent(max(bands))} of full command, and {s.verb('move')} as fast as at full "
            f"command from {percent(min(full))} to {percent(max(full))} of it on"
        )
    return (
        f"{s.verb('differ')} from the model in a way that no known effect describes, depending on "
        f"{dependences(s.effect)}"
    )


_PREDICATES: dict[str, Callable[[Subject], str]] = {
    "gain": _gain,
    "delay": lambda s: f"{s.verb('react')} {s.amount('added_delay')} later than the model",
    "lag": _lag,
    "flow_coupling": _flow_coupling,
    "load": _load,
    "thermal_drift": _thermal_drift,
    "supply_variation": _supply_variation,
    "leakage": lambda s: f"{s.verb('creep')} at {s.amount('sag_rate', 'some speed')} without a command",
    "backlash": lambda s: f"{s.verb('lose')} {s.amount('width', 'some motion')} at every reversal",
    "stiction": lambda s: f"{s.verb('start')} {s.amount('mean_extra_time')} late after resting",
    "end_cushion": _end_cushion,
    "sensor_bias": lambda s: f"{s.verb('have')} an encoder that reads wrongly",
    "timing": lambda s: f"{s.verb('have')} measurements that arrive {s.amount('latency')} late",
    "oscillation": lambda s: (
        f"{s.verb('ring')} at {s.amount('frequency', 'some frequency')} after starts and stops"
    ),
    "other": _other,
}
