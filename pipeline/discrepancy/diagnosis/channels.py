"""What the machine's channels range over, and what a dependence on them explains of nominal logs."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discrepancy.diagnosis.nominal.null_gains import null_gains
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour
from pipeline.discrepancy.diagnosis.sequences import Sequences
from pipeline.discrepancy.diagnosis.simulation import Simulation
from pipeline.discrepancy.families.uncorrectable import WITHOUT_WRAPPER
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.effects.dependence import OnChannel
from pipeline.effects.effect import Channel
from pipeline.errors import InputError

RANGE = (0.01, 0.99)  # quantiles of the measured values: a curve's ends need rows
LAG_S = 2.0  # half of the 4 s over which predictions are judged
SMALLEST_KNOWN = 0.5  # share of the measured rows, for a channel to be looked at


def channels_of(
    nominal: Sequences,
    measured: Sequences,
    names: Sequence[str],
    dt_s: float,
    given: tuple[Channel, ...] = (),
) -> tuple[Channel, ...]:
    """The channels' ranges; empty where none varies over the measured logs.

    The range holds the usual value, too, from which the curve counts: the median of the nominal logs, or of the
    measured ones where the nominal logs lack the channel. Effects of a given model keep theirs.

    Raises:
        InputError: Those are of other channels.
    """
    if given:
        if [channel.name for channel in given] != list(names):
            raise InputError(
                f"the model's effects are of channels {', '.join(c.name for c in given)}, conf/machine declares "
                f"{', '.join(names) or 'none'}; name a model without effects"
            )
        return given
    channels = []
    for index, name in enumerate(names):
        before, values = (of.channels[..., index][of.is_row] for of in (nominal, measured))
        known, before = values[np.isfinite(values)], before[np.isfinite(before)]
        channel = Channel(name, 0.0, 0.0, 0.0)
        if len(known) > SMALLEST_KNOWN * len(values):
            lower, upper = np.quantile(known, RANGE)
            usual = float(np.median(before if len(before) else known))
            if upper > lower:
                kept = _kept(measured.channels[..., index] - usual, measured.is_row, round(LAG_S / dt_s))
                kept_per_s = kept ** (1.0 / LAG_S)
                channel = Channel(name, min(float(lower), usual), max(float(upper), usual), usual, kept_per_s)
        channels.append(channel)
    return tuple(channels) if any(channel.upper > channel.lower for channel in channels) else ()


def _kept(distance: np.ndarray, is_row: np.ndarray, lag: int) -> float:
    """Share of a distance (B, T) that is left so many rows later, in [0, 1], by least squares."""
    now, later = distance[:, :-lag], distance[:, lag:]
    both = is_row[:, :-lag] & is_row[:, lag:] & np.isfinite(now) & np.isfinite(later)
    return float(np.clip(now[both] @ later[both] / max(now[both] @ now[both], 1e-12), 0.0, 1.0))


def with_channels(
    nominal: NominalBehaviour, channels: tuple[Channel, ...], config: CloseLoopConfig
) -> NominalBehaviour:
    """The same with dependences on channels, and what they explain of nominal logs over these ranges."""
    family, before = OnChannel.card.family, nominal.simulation
    if not channels or family in config.exclude:
        return nominal
    setting = replace(nominal.setting, channels=channels)
    left_out = nominal.diagnosis.left_out[..., : before.sequences.q.shape[1]]
    simulation = Simulation(nominal.diagnosis, before.sequences, nominal.effects, setting, left_out)
    simulation = simulation.with_phases(nominal.phases)
    others = [*(f for f in simulation.effects if f != family), *WITHOUT_WRAPPER]
    of_channels = null_gains(simulation, nominal.rows, others, config.search.null_factor).misfits
    return replace(nominal, setting=setting, simulation=simulation, null={**nominal.null, **of_channels})
