"""Section `search.study` of a profile: how a study proposes, prunes and re-assigns trials."""

import enum
from dataclasses import dataclass

from pipeline.errors import InputError


class SamplerKind(enum.StrEnum):
    """How hyper-parameters are proposed; the paper does not say."""

    tpe = "tpe"  # tree-structured Parzen estimator (Bergstra et al., 2011)
    random = "random"


class Pruner(enum.StrEnum):
    """How unpromising trials are ended early; the paper does not prune."""

    none = "none"
    median = "median"  # worse than the median of the earlier trials at the same epoch
    hyperband = "hyperband"  # Li et al., 2018


@dataclass
class StudySettings:
    """How trials are proposed, ended, and passed from a dead worker to a live one.

    Attributes:
        seed: Of the proposals; each trial has its own generator.
        sampler: Proposes hyper-parameters.
        startup_trials: Trials that the sampler `tpe` draws at random before it models results.
        pruner: Ends unpromising trials.
        pruner_warmup_epochs: Epochs before a trial can be pruned.
        heartbeat_s: Interval between a worker's heartbeats.
        stale_after_s: A trial is taken over after this time without a heartbeat from another computer.
            A dead worker on the same computer is detected at once.
        maximum_attempts: A trial is given up after so many dead workers: the trial may cause the deaths.
    """

    seed: int
    sampler: SamplerKind
    startup_trials: int
    pruner: Pruner
    pruner_warmup_epochs: int
    heartbeat_s: float
    stale_after_s: float
    maximum_attempts: int

    def __post_init__(self) -> None:
        for name in ("startup_trials", "pruner_warmup_epochs", "maximum_attempts"):
            if getattr(self, name) < 1:
                raise InputError(f"search.study.{name} is {getattr(self, name)}; it must be at least 1")
        if self.seed < 0:
            raise InputError(f"search.study.seed is {self.seed}; it must not be negative")
        if not self.heartbeat_s > 0:
            raise InputError(f"search.study.heartbeat_s is {self.heartbeat_s}; it must be positive")
        if not self.stale_after_s >= 2 * self.heartbeat_s:
            raise InputError(
                f"search.study.stale_after_s is {self.stale_after_s}; it must be at least twice heartbeat_s "
                f"({self.heartbeat_s}), or live workers pass for dead"
            )
