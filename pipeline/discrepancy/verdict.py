"""From effects on joints to a verdict: what belongs together is one effect, and what it depends on gets its name."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.discrepancy.common_speed import FAMILY as SUPPLY
from pipeline.discrepancy.found import Found
from pipeline.discrepancy.plausibility import DEAD_BAND
from pipeline.discrepancy.whole_machine import are_equal_delays
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.store import KNOWN

MERGED = ("thermal_drift", SUPPLY, "flow_coupling", "load", DEAD_BAND, "other:activity")


@dataclass(frozen=True)
class Effect:
    """One effect of the verdict.

    Attributes:
        family: As in the contract; `other` for all dependences.
        members: The effects on single joints that it is made of.
    """

    family: str
    members: list[Found]

    @property
    def card(self) -> str:
        """Key of its card: of a dependence that of its form."""
        return self.members[0].candidate.family if self.family == "other" else self.family

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
    def equivalents(self) -> list:
        """What the logs cannot tell from it."""
        return [] if self.family == "timing" else [e for m in self.members for e in m.equivalents]

    @property
    def gain(self) -> float:
        """Of all members."""
        return sum(member.candidate.gain for member in self.members)


def effects_of(found: Sequence[Found], excited: Sequence[int], allow_timing: bool = True) -> list[Effect]:
    """Group what was found on single joints, strongest first.

    Args:
        found: Of the search.
        excited: Joints that move enough to tell.
        allow_timing: Whether equal delays of all joints may be named `timing`.
    """
    left = list(found)
    effects = []
    delays = [f for f in left if f.candidate.family == "delay"]
    is_one = len({f.candidate.onset for f in delays}) == 1
    is_everywhere = len(delays) >= 2 and {f.candidate.joint for f in delays} >= set(excited)
    if allow_timing and is_one and is_everywhere and are_equal_delays([f.candidate for f in delays]):
        effects.append(Effect("timing", delays))
        left = [f for f in left if f not in delays]
    for family in MERGED:
        members = [f for f in left if f.candidate.family == family]
        if members:
            effects.append(Effect("other" if family.startswith("other") else family, members))
            left = [f for f in left if f not in members]
    effects += [
        Effect("other" if f.candidate.family.startswith("other") else f.candidate.family, [f]) for f in left
    ]
    return sorted(effects, key=lambda effect: -effect.gain)


def depends_on(effect: Effect, joints: Sequence[str]) -> list[str]:
    """Entries as in the contract: `variable` or `variable:joint`."""
    entries: list[str] = []
    for member in effect.members:
        candidate = member.candidate
        if effect.family == "timing":
            entries.append("clock")
        elif candidate.family == SUPPLY:
            entries.append("latent")
        elif candidate.family == "flow_coupling":
            entries += [
                f"command:{joints[freed[0][1]]}"  # type: ignore[index]
                for freed, value in zip(candidate.freed, candidate.coefficients, strict=True)
                if freed[0][1] != candidate.joint and value > 0.02
            ]
        elif candidate.family == "load":
            entries.append(f"position:{joints[candidate.joint]}")
        elif candidate.family in DEPENDENCES:
            dependence = DEPENDENCES[candidate.family]
            source = candidate.joint if candidate.source is None else candidate.source
            entries.append(
                dependence.variable if dependence.common else f"{dependence.variable}:{joints[source]}"
            )
        else:
            entries += [
                entry.format(joint=joints[candidate.joint])
                for entry in KNOWN[candidate.family].card.depends_on
            ]
    return list(dict.fromkeys(entries))
