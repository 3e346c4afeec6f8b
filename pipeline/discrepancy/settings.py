"""Section `close_loop` of a profile."""

from dataclasses import dataclass, field

from pipeline.discrepancy.acceptance.gate import GateConfig
from pipeline.discrepancy.baselines.continued_training import BaselinesConfig
from pipeline.discrepancy.diagnosis.splits import SplitConfig
from pipeline.discrepancy.families.uncorrectable import refuse_unknown
from pipeline.discrepancy.selection.search_thresholds import EffectSearchConfig
from pipeline.dynamics.settings import TrainingConfig
from pipeline.errors import InputError
from pipeline.machine.workspace import EnvelopeConfig


@dataclass
class ExperimentConfig:
    """What an experiment may take.

    Attributes:
        motion_s: Seconds of motion, at most.
        rounds: How often it is played: rows to fit, to select and to confirm on should each see it.
        reaction_s: From a joint state to the command that a supervisor gives because of it, at the longest.
        envelope: Region that it stays in.
        after_none: Whether one is planned for small effects, too, where every joint moved and nothing was suspected.
    """

    motion_s: float
    rounds: int
    reaction_s: float
    envelope: EnvelopeConfig
    after_none: bool

    def __post_init__(self) -> None:
        if not (self.motion_s > 0 and self.reaction_s >= 0) or self.rounds < 1:
            raise InputError(
                "close_loop.experiment: motion_s must be positive, reaction_s not negative, rounds at least 1"
            )


@dataclass
class CloseLoopConfig:
    """How the loop is closed.

    Attributes:
        seed: Of all networks, and of resampling.
        baseline: Training of the model, where none is given and one of the paper's kinds is asked for.
        split: Of the measured rows.
        search: Thresholds of the search.
        gate: Thresholds of the gate.
        experiment: What the next experiment may take.
        baselines: Whether other corrections are tried on the same rows, to compare with.
        baselines_budget: Of those that are trained.
        exclude: Families that are not tried.
    """

    seed: int
    baseline: TrainingConfig
    split: SplitConfig
    search: EffectSearchConfig
    gate: GateConfig
    experiment: ExperimentConfig
    baselines: bool
    baselines_budget: BaselinesConfig
    exclude: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        refuse_unknown(self.exclude)
