"""Positions that were recorded in degrees or millimetres, while the machine's configuration says rad and m."""

import math

import numpy as np

from pipeline.logs.conditioning.encoder_rules import LARGEST_POSITION, TURN
from pipeline.logs.conditioning.order_statistics import quantiles, widened
from pipeline.logs.messages.columns import sections
from pipeline.logs.messages.raw_log import Note, NoteKind, RawLog
from pipeline.machine.specification import JointKind, MachineSpecification

UNITS = {JointKind.revolute: ("degrees", math.pi / 180), JointKind.prismatic: ("mm", 0.001)}
MOST = [0.05, 0.95]  # quantiles, so that single faults of an encoder do not count


def unit_warnings(raw: RawLog, machine: MachineSpecification) -> list[Note]:
    """Warn of joints whose positions span more than limits and wrap-around allow, but less in the other unit.

    One joint may turn without end. At least half of a kind's joints must span more than allowed, then; joints that
    move by so little that both units are possible at rest do not count.
    """
    kinds = np.array([JointKind(joint.kind) for joint in machine.joints])
    allowed = machine.upper - machine.lower
    most = np.where(kinds == JointKind.revolute, np.maximum(allowed, TURN), allowed)
    low, high = np.full(machine.n_joint, np.inf), np.full(machine.n_joint, -np.inf)
    for (section,) in sections((raw.q,)):
        # A joint's positions side by side: NumPy reduces those much faster.
        q = np.ascontiguousarray(section.T)
        low, high = widened(low, high, q, np.abs(q) <= LARGEST_POSITION)
    if not (high - low > most).any():  # which is the rule, and quickly told
        return []
    low, high = np.array([_most_positions(raw, number) for number in range(machine.n_joint)]).T
    span, notes = high - low, []
    for kind, (unit, scale) in UNITS.items():
        is_out, is_within = (kinds == kind) & (span > most), (kinds == kind) & (span <= most)
        fits = (low * scale >= machine.lower) & (high * scale <= machine.upper)
        if (
            not is_out.any()
            or not fits[is_out].all()
            or is_out.sum() < (is_within & (span > scale * allowed)).sum()
        ):
            continue
        worst = int(np.argmax(np.where(is_out, span / allowed, 0)))
        text = (
            f"the positions of {machine.joint_names[worst]} span {span[worst] / allowed[worst]:.3g} times its limits "
            f"({low[worst]:.4g} to {high[worst]:.4g} {machine.units[worst]}) and look like {unit}; set "
            f"joint_states.scale to {scale:.16g} in conf/machine/{machine.name}.yaml"
        )
        notes.append(Note(NoteKind.warning, text, len(raw.q)))
    return notes


def _most_positions(raw: RawLog, joint: int) -> list[float]:
    """The quantiles of a joint's possible positions; NaN without any."""

    def possible() -> list[np.ndarray]:
        columns = (q[:, joint] for (q,) in sections((raw.q,)))
        return [values[np.abs(values) <= LARGEST_POSITION] for values in columns]

    return quantiles(possible, MOST) if any(map(len, possible())) else [math.nan, math.nan]
