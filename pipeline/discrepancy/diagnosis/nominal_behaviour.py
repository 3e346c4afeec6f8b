"""What the nominal logs alone say: how the machine moved, and how far its diagnosis model can be trusted.

It holds for whatever is measured later, on that machine or on others of its kind.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.discrepancy.diagnosis.diagnosis_model import (
    DiagnosisModel,
    train_diagnosis_model,
    training_of_diagnosis,
)
from pipeline.discrepancy.diagnosis.nominal.floor_at_rest import floor_at_rest
from pipeline.discrepancy.diagnosis.nominal.nominal_cache import (
    Learned,
    identity,
    load_learned,
    save_learned,
    without,
)
from pipeline.discrepancy.diagnosis.nominal.null_gains import null_gains
from pipeline.discrepancy.diagnosis.sampling_phase import sampling_phases
from pipeline.discrepancy.diagnosis.scored_rows import ScoredRows, alternating_folds, averaged, rows_in_blocks
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.simulation import NOMINAL, Simulation
from pipeline.discrepancy.diagnosis.training_support import is_known
from pipeline.discrepancy.selection.candidate import Nominal
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.effects.catalogue import known_for
from pipeline.effects.effect import Effect, Setting
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import CommandKind, MachineSpecification

FOLD_ROWS = 1200


@dataclass(frozen=True)
class NominalBehaviour:
    """Learned from nominal logs.

    Attributes:
        diagnosis: Speeds from commands and positions, with the members that did not see a row.
        setting: What wrappers need to know of the machine.
        is_switched: Whether commands are -1, 0 or 1, so that their number says what joints ask for together.
        effects: Those of the catalogue that are tried.
        sequences: All nominal rows.
        simulation: Of as many of them as the search is tried on.
        rows: Those rows.
        phases: (B,) [steps] by which all joints of each log respond late.
        floor: (n_joint,) mean square of the speeds' residual after averaging [(rad/s)², (m/s)²].
        at_rest: (n_joint,) the same of joints at rest, in units of `floor`.
        null: What each candidate gains though there is nothing to be found.
        present: Families of effects that nominal logs show themselves.
    """

    diagnosis: DiagnosisModel
    setting: Setting
    is_switched: bool
    effects: list[type[Effect]]
    sequences: Sequences
    simulation: Simulation
    rows: ScoredRows
    phases: np.ndarray
    floor: np.ndarray
    at_rest: np.ndarray
    null: Nominal
    present: tuple[str, ...]

    def shows(self, rows: Sequences) -> np.ndarray:
        """(B, T, n_joint) bool: where nominal logs show how a joint moves."""
        return is_known(self.sequences, rows, self.setting, self.is_switched)


def learn_nominal_behaviour(
    nominal: Sequence[Trajectory],
    machine: MachineSpecification,
    config: CloseLoopConfig,
    identify: IdentifyConfig,
    end_part: Callable[[str], None] = lambda _: None,
    kept: Path | None = None,
) -> NominalBehaviour:
    """Train the diagnosis model, and search the nominal logs for effects: what is found there is its misfit.

    Args:
        nominal: Logs of the machine as it was.
        config: Section `close_loop`.
        identify: Section `identify`.
        end_part: Called with each part's name at its end.
        kept: File of what was learned of the same logs before (`nominal_cache.py`); rewritten if they are others.

    Raises:
        InputError: That file is damaged, or cannot be written.
        UnusableLogs: The logs are too short.
    """
    known_as = identity(nominal, machine, config, identify)
    known = load_learned(kept, known_as) if kept is not None else None
    history_rows = training_of_diagnosis(identify).lags + 1
    every = side_by_side(nominal, machine.dt_s, history_rows, machine.channel_names)
    is_switched = machine.command_kind is CommandKind.discrete
    diagnosis = (
        known.diagnosis
        if known is not None
        else train_diagnosis_model(nominal, every.q.shape[1], machine, identify, config.seed)
    )
    speed = np.array(diagnosis.model.specification.residual_scale)
    setting = Setting(machine.dt_s, machine.lower, machine.upper, speed)
    effects = [e for f, e in known_for(machine.command_kind).items() if f not in config.exclude]
    end_part("diagnosis model")
    # More nominal rows than this make the null no better known, but the search on them slow.
    n_rows = config.search.nominal_rows // len(every.is_row) + history_rows
    sequences = Sequences(*(column[:, :n_rows] for column in every))
    simulation = Simulation(diagnosis, sequences, effects, setting, diagnosis.left_out[..., :n_rows])
    phases = sampling_phases(simulation, sequences.is_row)
    simulation = simulation.with_phases(phases)
    weight = is_known(every, sequences, setting, is_switched)
    floor, at_rest = _floors(simulation, sequences, weight)
    block_rows = config.search.block_rows(machine.dt_s)
    fold = alternating_folds(sequences.is_row, block_rows, FOLD_ROWS)
    rows = rows_in_blocks(sequences.is_row, fold, weight, floor, block_rows)
    if known is not None:
        null, present = without(known.null, config.exclude), known.present
    else:
        null, present = null_gains(simulation, rows, config.exclude, config.search.null_factor)
        if kept is not None and not config.exclude:  # else the next would miss what was not tried
            save_learned(kept, Learned(diagnosis, null, present), known_as)
    end_part("search on nominal logs")
    of_machine = diagnosis, setting, is_switched, effects
    return NominalBehaviour(*of_machine, every, simulation, rows, phases, floor, at_rest, null, present)


def _floors(
    simulation: Simulation, sequences: Sequences, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`floor` and `at_rest` of `NominalBehaviour`, on rows of `weight` (B, T, n_joint) 1."""
    missed = sequences.velocity - simulation.velocities([NOMINAL])[0]
    is_whole = averaged(weight.astype(float), sequences.is_row) > 0.999
    residual = is_whole * averaged(missed, sequences.is_row)
    floor = np.maximum(np.mean(residual**2, axis=0), 1e-12)
    dt_s = simulation.setting.dt_s
    return floor, floor_at_rest(residual, sequences.command, sequences.is_row, floor, dt_s)
