"""Step 1: logs side by side, and which measured rows are for fitting, for selection and for confirmation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.diagnosis.diagnosis_model import training_of_diagnosis
from pipeline.discrepancy.diagnosis.sequences import Sequences, side_by_side
from pipeline.discrepancy.diagnosis.splits import Purpose, split_rows
from pipeline.discrepancy.diagnosis.window_starts import starts_within
from pipeline.discrepancy.settings import CloseLoopConfig
from pipeline.discrepancy.unusable_logs import UnusableLogs
from pipeline.dynamics.settings import IdentifyConfig
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import MachineSpecification


@dataclass(frozen=True)
class PreparedLogs:
    """What a run is given, with the measured rows split before anything is learned.

    Attributes:
        nominal: Logs of the machine that the model describes.
        measured: Logs of the machine as it is.
        machine: Its specification.
        config: Section `close_loop`.
        identify: Section `identify`.
        sequences: The measured logs.
        purposes: Per measured log (T,) of `splits.Purpose`.
        label: (B, T) the same.
        rule: How they were split, in words.
    """

    nominal: Sequence[Trajectory]
    measured: Sequence[Trajectory]
    machine: MachineSpecification
    config: CloseLoopConfig
    identify: IdentifyConfig
    sequences: Sequences
    purposes: list[np.ndarray]
    label: np.ndarray
    rule: str

    @property
    def is_of_one_machine(self) -> bool:
        """Whether the logs on both sides are the same: what is sought is what a given model lacks of them."""
        return self.measured is self.nominal

    @property
    def joints(self) -> list[str]:
        """Names in order."""
        return list(self.machine.joint_names)

    @property
    def units(self) -> list[str]:
        """Per joint `rad` or `m`."""
        return list(self.machine.units)


def prepare(
    nominal: Sequence[Trajectory],
    measured: Sequence[Trajectory],
    machine: MachineSpecification,
    config: CloseLoopConfig,
    identify: IdentifyConfig,
) -> PreparedLogs:
    """Split the measured rows; arguments as of `PreparedLogs`.

    Raises:
        UnusableLogs: The measured logs are too short.
    """
    dt_s = machine.dt_s
    history_rows = training_of_diagnosis(identify).lags + 1
    sequences = side_by_side(measured, dt_s, history_rows, machine.channel_names)
    purposes, rule = split_rows([len(t) for t in measured], dt_s, config.split)
    if not any(len(starts_within(purpose == Purpose.confirm, 80)) for purpose in purposes):
        raise UnusableLogs(
            "measured",
            f"{sum(map(len, measured)) * dt_s:.0f} s are too short to hold a window "
            "of 80 steps back from the fit; record three minutes or more",
        )
    label = np.zeros(sequences.is_row.shape, np.int8)
    for index, purpose in enumerate(purposes):
        label[index, : len(purpose)] = purpose
    return PreparedLogs(nominal, measured, machine, config, identify, sequences, purposes, label, rule)
