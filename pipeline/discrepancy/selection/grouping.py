"""From effects on joints to effects of the machine: what belongs together is one, and what it depends on has a name."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from pipeline.discrepancy.families.late_channel import late_channel
from pipeline.discrepancy.families.plausibility import (
    CHANNEL,
    DELAY,
    FLOW_COUPLING,
    LOAD,
    TIMING,
)
from pipeline.discrepancy.families.shared_flow import coefficients_by_source
from pipeline.discrepancy.families.supply_variation import FAMILY as SUPPLY
from pipeline.discrepancy.families.time_varying_gain import FAMILY as COURSE
from pipeline.discrepancy.families.uncorrectable import has_wrapper
from pipeline.discrepancy.families.whole_machine import OF_ONE_CAUSE
from pipeline.discrepancy.selection.candidate import Candidate
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.effects.catalogue import KNOWN
from pipeline.effects.dependence import DEPENDENCES
from pipeline.machine.specification import MachineSpecification

OTHER = "other"
SMALLEST_LOSS = 0.02  # by a joint's demand, for a speed to be said to depend on it


@dataclass(frozen=True)
class MachineEffect:
    """One effect of the verdict.

    Attributes:
        family: As in the contract; `other` for all dependences, and for one cause that may not be named.
        members: The effects on single joints that it is made of.
    """

    family: str
    members: list[SelectedEffect]

    @property
    def card(self) -> str:
        """Key of its card: of a dependence that of its form."""
        return self.members[0].candidate.family if self.family == OTHER else self.family

    @property
    def has_wrapper(self) -> bool:
        """Whether there is something to put into the model."""
        return has_wrapper(self.members[0].candidate)

    @property
    def is_known(self) -> bool:
        """Whether the given model has it."""
        return self.members[0].known is not None

    @property
    def can_lose_joints(self) -> bool:
        """Whether a joint may turn out to have no part in it: one cause on several joints, but not a late channel."""
        return self.members[0].candidate.family in OF_ONE_CAUSE

    @property
    def joints(self) -> list[int]:
        """Indices of its joints."""
        return sorted({member.candidate.joint for member in self.members})

    @property
    def onset(self) -> int | None:
        """Stamp at which it sets in."""
        onsets = [m.candidate.onset for m in self.members if m.candidate.onset is not None]
        return min(onsets) if len(onsets) == len(self.members) else None

    @property
    def equivalents(self) -> list[Candidate]:
        """What the logs cannot tell from it."""
        return [] if self.family == TIMING else [e for m in self.members for e in m.equivalents]

    @property
    def probability(self) -> float:
        """Of its name, given that something has changed; 1 where nothing was compared with it.

        A late channel has that of all that is as good on one joint: no other cause makes all joints late alike.
        """
        compared = next((m for m in self.members if m.shares), None)
        if compared is None:
            return 1.0
        even = compared.equivalents if self.family == TIMING else []
        return sum(compared.shares.get(c.key, 0.0) for c in (compared.candidate, *even))

    @property
    def gain(self) -> float:
        """Of all members."""
        return sum(member.candidate.gain for member in self.members)


def effects_of(
    found: Sequence[SelectedEffect], excited: Collection[int], allow_timing: bool = True
) -> list[MachineEffect]:
    """Group what was found on single joints, strongest first.

    Args:
        found: Of the search.
        excited: Joints that move enough to tell.
        allow_timing: Whether equal delays of all joints that move enough may be named `timing`. So many causes at once
            they are not in any case.
    """
    effects: list[MachineEffect] = []
    left = list(found)
    delays = [f for f in left if f.candidate.family == DELAY]
    channel = late_channel([f.candidate for f in delays], excited)
    if channel:
        joints = {candidate.joint for candidate in channel}
        late = [f for f in delays if f.candidate.joint in joints]
        effects.append(MachineEffect(TIMING if allow_timing else OTHER, late))
        left = [f for f in left if f not in late]
    for family, source in dict.fromkeys((f.candidate.family, f.candidate.source) for f in left):
        if family in (*OF_ONE_CAUSE, COURSE):
            members = [f for f in left if (f.candidate.family, f.candidate.source) == (family, source)]
            effects.append(MachineEffect(told_as(family), members))
            left = [f for f in left if f not in members]
    effects += [MachineEffect(contract_family(f.candidate), [f]) for f in left]
    return sorted(effects, key=lambda effect: -effect.gain)


def contract_family(candidate: Candidate) -> str:
    """Its name in the contract's table."""
    return told_as(candidate.family)


def told_as(family: str) -> str:
    """A family's name in the contract's table: `other` for every dependence."""
    return OTHER if family.startswith(OTHER) else family


def source_of(candidate: Candidate, machine: MachineSpecification) -> str | None:
    """Name of the joint or channel whose variable it is; None: the joint's own, or the machine's."""
    names = machine.channel_names if candidate.family == CHANNEL else machine.joint_names
    return None if candidate.source is None else names[candidate.source]


def candidate_depends_on(candidate: Candidate, machine: MachineSpecification) -> list[str]:
    """As `depends_on`, of what nothing has named."""
    return depends_on(MachineEffect(OTHER, [SelectedEffect(candidate)]), machine)


def depends_on(effect: MachineEffect, machine: MachineSpecification) -> list[str]:
    """Entries as in the contract: `variable`, `variable:joint` or `channel:name`."""
    entries: list[str] = []
    joints = machine.joint_names
    for member in effect.members:
        candidate = member.candidate
        if effect.family == TIMING:
            entries += KNOWN[TIMING].card.depends_on
        elif candidate.family == SUPPLY:
            entries.append("latent")
        elif candidate.family == COURSE:
            entries.append("absolute_time")
        elif candidate.family == FLOW_COUPLING:
            entries += [
                f"command:{joints[source]}"
                for source, index in coefficients_by_source(candidate).items()
                if candidate.coefficients[index] > SMALLEST_LOSS
            ]
        elif candidate.family == LOAD:
            entries.append(f"position:{joints[candidate.joint]}")
        elif candidate.family in DEPENDENCES:
            variable = DEPENDENCES[candidate.family].variable
            is_common = DEPENDENCES[candidate.family].common
            source = source_of(candidate, machine) or (None if is_common else joints[candidate.joint])
            entries.append(variable if source is None else f"{variable}:{source}")
        else:
            entries += [
                entry.format(joint=joints[candidate.joint])
                for entry in KNOWN[candidate.family].card.depends_on
            ]
    return list(dict.fromkeys(entries))
