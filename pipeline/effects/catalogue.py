"""All families with a wrapper. A new effect is one file, one line here, and its test."""

from collections.abc import Sequence

from pipeline.effects.backlash import Backlash
from pipeline.effects.dead_band import DeadBand
from pipeline.effects.delay import Delay
from pipeline.effects.dependence import DEPENDENCES
from pipeline.effects.effect import Effect
from pipeline.effects.end_cushion import EndCushion
from pipeline.effects.flow_coupling import FlowCoupling
from pipeline.effects.gain import Gain
from pipeline.effects.lag import Lag
from pipeline.effects.leakage import Leakage
from pipeline.effects.load import Load
from pipeline.effects.oscillation import Oscillation
from pipeline.effects.sensor_bias import SensorBias
from pipeline.effects.stiction import Stiction
from pipeline.effects.thermal_drift import ThermalDrift
from pipeline.effects.timing import Timing
from pipeline.effects.varying_speed import VaryingSpeed
from pipeline.machine.specification import CommandKind

CATALOGUE: dict[str, type[Effect]] = {
    effect.card.family: effect
    for effect in (
        Gain,
        Delay,
        Lag,
        FlowCoupling,
        Load,
        ThermalDrift,
        Leakage,
        Backlash,
        Stiction,
        EndCushion,
        SensorBias,
        Timing,
        Oscillation,
    )
}

# Effects with their own equation but without a family in the contract: reported as `other`.
BEYOND_THE_CONTRACT: dict[str, type[Effect]] = {DeadBand.card.family: DeadBand}

WITH_AN_EQUATION: dict[str, type[Effect]] = {**CATALOGUE, **BEYOND_THE_CONTRACT}
KNOWN: dict[str, type[Effect]] = {**WITH_AN_EQUATION, **DEPENDENCES}

# What corrects a model and is no explanation: it is fitted beside what was named, and never searched for.
CORRECTIONS: dict[str, type[Effect]] = {VaryingSpeed.card.family: VaryingSpeed}
IN_MODELS: dict[str, type[Effect]] = {**KNOWN, **CORRECTIONS}


def families(excluded: Sequence[str] = ()) -> list[str]:
    """Names of the families, without the excluded ones."""
    return [family for family in CATALOGUE if family not in excluded]


def known_for(command_kind: CommandKind) -> dict[str, type[Effect]]:
    """Effects that are identifiable from commands of this kind."""
    is_discrete = command_kind is CommandKind.discrete
    return {
        family: effect
        for family, effect in KNOWN.items()
        if not (is_discrete and effect.needs_proportional_commands)
    }
