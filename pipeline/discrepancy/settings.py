"""Section `close_loop` of a profile."""

import enum
from dataclasses import dataclass, field

from pipeline.discrepancy.acceptance.gate import GateConfig
from pipeline.discrepancy.baselines.continued_training import BaselinesConfig
from pipeline.discrepancy.diagnosis.splits import SplitConfig
from pipeline.discrepancy.families.uncorrectable import refuse_unknown
from pipeline.discrepancy.posterior.posterior_config import PosteriorConfig
from pipeline.discrepancy.selection.search_thresholds import EffectSearchConfig
from pipeline.dynamics.settings import TrainingConfig


class Engine(enum.StrEnum):
    """How effects are chosen."""

    rules = "rules"  # forward selection, `selection/search.py`
    posterior = "posterior"  # `posterior/explanations.py`


@dataclass
class CloseLoopConfig:
    """How the loop is closed.

    Attributes:
        seed: Of all networks, and of resampling.
        baseline: Training of the model, where none is given and one of the paper's kinds is asked for.
        split: Of the measured rows.
        search: Thresholds of the search.
        gate: Thresholds of the gate.
        posterior: When the posterior tells an effect.
        baselines: Whether other corrections are tried on the same rows, to compare with.
        baselines_budget: Of those that are trained.
        exclude: Families that are not tried.
        engine: How effects are chosen.
    """

    seed: int
    baseline: TrainingConfig
    split: SplitConfig
    search: EffectSearchConfig
    gate: GateConfig
    posterior: PosteriorConfig
    baselines: bool
    baselines_budget: BaselinesConfig
    exclude: list[str] = field(default_factory=list)
    engine: Engine = Engine.rules

    def __post_init__(self) -> None:
        refuse_unknown(self.exclude)
