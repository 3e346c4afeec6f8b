"""What confirmation rows, which no fit saw, say of an effect of the machine.

They ask for a size of it, as it was fitted, beside all others: about one if the effect is there. Parts of the nominal
logs, which are without it, ask for sizes, too: these are usual where it is not. What a size is beyond them, over its
standard deviation, has Student's t distribution there, and becomes an e-value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr
from scipy.stats import t

from pipeline.discrepancy.acceptance.e_value import e_value_of
from pipeline.discrepancy.acceptance.fitted_effects import FittedEffects
from pipeline.discrepancy.acceptance.nominal_sizes import nominal_sizes
from pipeline.discrepancy.acceptance.parameter_misfit import without_onsets
from pipeline.discrepancy.acceptance.parameters import parameters_of
from pipeline.discrepancy.acceptance.shown import Deviation, Shown, shown_on
from pipeline.discrepancy.diagnosis.diagnose import Diagnosis
from pipeline.discrepancy.families.stops import Encoder
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.supply_variation import why_it_is_no_supply
from pipeline.discrepancy.selection.candidate import Key
from pipeline.discrepancy.selection.grouping import MachineEffect
from pipeline.discrepancy.selection.selected_effect import SelectedEffect


class Size(NamedTuple):
    """Of an effect, in units of the fitted one.

    Attributes:
        value: That rows ask for.
        usual: Where there is no effect.
        deviation: From that.
    """

    value: float
    usual: float
    deviation: Deviation

    @property
    def p_value(self) -> float:
        """How probable so large a size is, were the effect not there."""
        beyond = self.value - self.usual
        return float(t.sf(beyond / max(self.deviation.value, 1e-12), self.deviation.freedom))

    @property
    def is_nearer_to_the_fitted(self) -> bool:
        """Whether it is nearer to one than to what is usual: the likelier of both, as both scatter alike."""
        return self.value > 0.5 * (1.0 + self.usual)


@dataclass(frozen=True)
class Confirmed:
    """Of one effect on one joint.

    Attributes:
        share: Of the squared residual on confirmation rows that it removes.
        size: That these ask for; None: it was seen at the stops.
        e_value: Of the effect of the machine that it is part of.
        why_not: A clause why it does not pass the gate; None: it does.
    """

    share: float
    size: Size | None
    e_value: float
    why_not: str | None = None


def confirm(
    fit: FittedEffects, effect: MachineEffect, encoders: Mapping[int, Encoder], smallest_e_value: float
) -> dict[Key, Confirmed]:
    """One judgement per joint of an effect, beside all other effects of the fit.

    Args:
        fit: All effects.
        effect: One of them.
        encoders: What the stops say of joints' encoders.
        smallest_e_value: Of an effect that passes.
    """
    joints = effect.joints
    measured = on_confirmation_rows(fit, effect)
    of_joints: Sequence[Size | None]
    if all(member.candidate.deviation is not None for member in effect.members):  # by the stops
        of_joints = [None] * len(joints)
        p_value = min(float(ndtr(-encoders[joint].z)) for joint in joints) * len(fit.diagnosis.logs.joints)
    else:
        whole, *of_joints = sizes(fit, effect, measured)
        p_value = whole.p_value
    e_value = e_value_of(p_value)
    why_not = None if e_value >= smallest_e_value else f"its e-value is below {smallest_e_value:g}"
    if effect.family == SUPPLY:
        time = parameters_of(fit, effect)["correlation_time"]
        why_not = why_it_is_no_supply(time["value"], len(joints)) or why_not
    result = {}
    for member in effect.members:
        column = joints.index(member.candidate.joint)
        size = of_joints[column]
        has_no_part = len(joints) > 1 and size is not None and not size.is_nearer_to_the_fitted
        result[member.candidate.key] = Confirmed(
            measured.on(column).share,
            size,
            e_value,
            why_not or ("this joint has no part in it" if has_no_part else None),
        )
    return result


def sizes(fit: FittedEffects, effect: MachineEffect, measured: Shown) -> list[Size]:
    """On all joints of an effect together, and on each.

    A size scatters by what differs between blocks of the rows, and by what the model is off by on nominal logs.
    """
    columns, diagnosis = range(len(effect.joints)), fit.diagnosis
    parts = [measured, *map(measured.on, columns)]
    block = diagnosis.held_out.folds.block
    by_blocks = [Size(of.size, 0.0, of.deviation_by_blocks(block)) for of in parts]
    if not are_without(diagnosis, effect.family):
        return by_blocks
    members = without_onsets(effect.members)
    nominal = shown_on(diagnosis.nominal.simulation, diagnosis.nominal.rows, members, members)
    # What follows the residual itself changes nominal logs by what they are off by: as much of it as measured rows hold
    # is a size of one.
    without = [nominal, *map(nominal.on, columns)]
    of_one = without if effect.has_wrapper else parts
    of_nominal = [
        nominal_sizes(of, one.squares / len(one.change)) for of, one in zip(without, of_one, strict=True)
    ]
    return [
        Size(size.value, usual.usual, size.deviation.and_of(usual.deviation_on(of.squares)))
        for size, usual, of in zip(by_blocks, of_nominal, parts, strict=True)
    ]


def are_without(diagnosis: Diagnosis, family: str) -> bool:
    """Whether nominal logs are without effects of a family: neither the measured ones, nor found to show it as well."""
    return not diagnosis.logs.is_of_one_machine and family not in diagnosis.nominal.present


def on_confirmation_rows(fit: FittedEffects, effect: MachineEffect) -> Shown:
    """What the effect does there, where it is known whether it has set in."""
    diagnosis = fit.diagnosis
    simulation, rows = diagnosis.simulation, diagnosis.held_out
    shown = shown_on(simulation, rows, fit.found, effect.members, diagnosis.rows)
    between = [m.candidate.onset_between for m in effect.members if m.candidate.onset_between is not None]
    stamps = simulation.sequences.stamp_ns
    may_set_in = np.any(
        [np.zeros(stamps.shape, bool), *((stamps >= of[0]) & (stamps < of[1]) for of in between)], axis=0
    )
    is_known = rows.averaged(may_set_in.astype(float))[:, None] == 0.0
    return Shown(is_known * shown.change, is_known * shown.residual)


def in_words(effect: SelectedEffect, judgement: Confirmed, joint: str) -> str:
    """The judgement as a sentence."""
    size = judgement.size
    told = (
        "the stops are where its values put them"
        if size is None
        else f"confirmation rows ask for {size.value:.0%} of its size, where {size.usual:.0%} ± "
        f"{size.deviation.value:.0%} are usual without it"
    )
    passes = "is confirmed" if judgement.why_not is None else f"is not confirmed, as {judgement.why_not}"
    return (
        f"{effect.candidate.family} on {joint} {passes}: {told} (e-value {judgement.e_value:.2g}); it removes "
        f"{judgement.share:.0%} of their squared residual."
    )
