"""Step 2: the diagnosis model runs on the measured logs, on the rows where nominal logs say how joints move."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.discrepancy.diagnosis.channels import channels_of, with_channels
from pipeline.discrepancy.diagnosis.diagnosis_model import DiagnosisModel
from pipeline.discrepancy.diagnosis.given_model import GivenModel
from pipeline.discrepancy.diagnosis.nominal.noise import noise_of
from pipeline.discrepancy.diagnosis.nominal_behaviour import NominalBehaviour, learn_nominal_behaviour
from pipeline.discrepancy.diagnosis.prepare import PreparedLogs
from pipeline.discrepancy.diagnosis.sampling_phase import sampling_phases
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, alternating_folds, rows_in_blocks
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.diagnosis.splits import Purpose
from pipeline.discrepancy.journal import Journal
from pipeline.discrepancy.selection.known.known_effects import known_effects
from pipeline.discrepancy.selection.selected_effect import SelectedEffect
from pipeline.dynamics.model.dynamics_model import DynamicsModel
from pipeline.dynamics.model.network import Parameters
from pipeline.effects.store import ActiveEffects

FOLD_ROWS = 200
TOLD_STEPS = 0.1
MOVING_SHARE = 0.3  # of a joint's usual speed


@dataclass(frozen=True)
class Diagnosis:
    """The measured logs beside what the nominal machine would have done.

    Attributes:
        logs: Of the step before.
        nominal: What nominal logs say.
        simulation: On the measured logs.
        phases: (B,) [steps] by which all joints of each measured log respond late.
        is_known: (B, T, n_joint) where nominal logs show how a joint moves.
        rows: For fitting and selection.
        held_out: For confirmation.
        moving_s: (n_joint,) [s] in motion on `rows`, where that counts.
        unknown_share: (n_joint,) of the time in motion on `rows`: what does not count.
        excited: Indices of the joints that move enough for a verdict.
        given: Effects that the given model has around it already; None: none.
        known: The same on single joints, in the simulation's terms.
    """

    logs: PreparedLogs
    nominal: NominalBehaviour
    simulation: Simulation
    phases: np.ndarray
    is_known: np.ndarray
    rows: ScoredRows
    held_out: ScoredRows
    moving_s: np.ndarray
    unknown_share: np.ndarray
    excited: list[int]
    given: ActiveEffects | None = None
    known: Sequence[SelectedEffect] = ()


def diagnose(
    logs: PreparedLogs,
    nominal: NominalBehaviour | None,
    kept: Path | None,
    journal: Journal,
    model: tuple[DynamicsModel, Parameters] | None = None,
    given: ActiveEffects | None = None,
) -> Diagnosis:
    """Simulate the measured logs; other arguments as of `close_loop`.

    Args:
        model: Whose omissions are sought, where `logs` are the nominal ones on both sides; None: the machine's change.
        given: Effects that the model to correct has already.

    Raises:
        InputError: The file `kept` is damaged, or cannot be written; the given effects are of other channels.
        UnusableLogs: The nominal logs are too short.
    """
    machine, config, sequences = logs.machine, logs.config, logs.sequences
    if nominal is None:
        nominal = learn_nominal_behaviour(
            logs.nominal, machine, config, logs.identify, journal.end_part, kept
        )
    journal.log(_floor_in_words(logs, nominal))
    runs: DiagnosisModel | GivenModel = nominal.diagnosis
    if model is not None:  # beside which nothing that the logs show is there already
        runs, nominal = GivenModel(*model, nominal.diagnosis), replace(nominal, present=())
    of_given = given.setting.channels if given is not None else ()
    channels = channels_of(nominal.sequences, sequences, machine.channel_names, machine.dt_s, of_given)
    nominal = with_channels(nominal, channels, config)
    simulation = Simulation(runs, sequences, nominal.effects, nominal.setting)
    used = sequences.is_row & np.isin(logs.label, (Purpose.fit, Purpose.select))
    # Of the same logs the identified model tells when recordings began, or a late model would be taken for that.
    phases = sampling_phases(simulation, used) if model is None else nominal.phases
    simulation = simulation.with_phases(phases)
    if np.any(np.abs(phases) > TOLD_STEPS):
        journal.log(_phases_in_words(phases, machine.dt_s))
    is_known = nominal.shows(sequences)
    block_rows = config.search.block_rows(machine.dt_s)
    in_blocks = partial(rows_in_blocks, is_known=is_known, floor=nominal.floor, block_rows=block_rows)
    rows = in_blocks(used, (logs.label == Purpose.select).astype(int))
    confirm = sequences.is_row & (logs.label == Purpose.confirm)
    held_out = in_blocks(confirm, alternating_folds(confirm, block_rows, FOLD_ROWS))
    moving_s, unknown_share = _motion(simulation, rows.is_used, is_known)
    known: list[SelectedEffect] = []
    if given is not None:
        known = known_effects(given, simulation, noise_of(nominal, machine.dt_s).correlated)
    excited = [j for j in range(len(moving_s)) if moving_s[j] >= config.gate.smallest_excitation_s]
    of_rows = phases, is_known, rows, held_out, moving_s, unknown_share, excited
    return Diagnosis(logs, nominal, simulation, *of_rows, given, known)


def _motion(
    simulation: Simulation, is_used: np.ndarray, is_known: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`moving_s` and `unknown_share` of `Diagnosis`, of rows in use (B, T) and known ones (B, T, n_joint)."""
    speed = np.abs(simulation.velocities([NOMINAL])[0])
    moving = (speed > MOVING_SHARE * simulation.setting.speed_scale) & is_used[..., None]
    n_known = (moving & is_known).sum(axis=(0, 1))
    return n_known * simulation.setting.dt_s, 1.0 - n_known / moving.sum(axis=(0, 1)).clip(1)


def _floor_in_words(logs: PreparedLogs, nominal: NominalBehaviour) -> str:
    of_joints = (
        f"{joint} {1e3 * np.sqrt(square):.1f} m{unit}/s"
        for joint, square, unit in zip(logs.joints, nominal.floor, logs.units, strict=True)
    )
    return (
        "On nominal logs that its members did not see, the diagnosis model is off by "
        f"{', '.join(of_joints)} (root mean square)."
    )


def _phases_in_words(phases: np.ndarray, dt_s: float) -> str:
    late_ms = ", ".join(f"{1e3 * dt_s * phase:.0f}" for phase in phases)
    return (
        f"In the measured logs all joints respond {late_ms} ms later than in nominal logs, because recordings begin "
        "between two ticks; this shift is removed."
    )
