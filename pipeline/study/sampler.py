"""Proposals and pruning, with a generator per trial: trial n's draws do not depend on the worker."""

from typing import Any

import numpy as np
import optuna
from optuna.distributions import BaseDistribution
from optuna.samplers import BaseSampler
from optuna.trial import FrozenTrial

from pipeline.study.settings import Pruner, SamplerKind, StudySettings
from pipeline.study.trials import trial_number


class SeededPerTrial(BaseSampler):
    """The configured sampler, seeded anew by (seed, number of the trial) before each trial.

    With one worker, the proposals are then the same even if it is killed and restarted.
    """

    def __init__(self, settings: StudySettings) -> None:
        self._settings = settings
        self._sampler: BaseSampler = _build(settings, 0)
        self.full_study: optuna.Study | None = None  # a pruner may pass a sampler only part of it

    def before_trial(self, study: optuna.Study, trial: FrozenTrial) -> None:
        """Seed."""
        attempts = (self.full_study or study).get_trials(deepcopy=False)
        number = trial_number(attempts, trial.number)
        self._sampler = _build(self._settings, number)
        self._sampler.before_trial(study, trial)

    def infer_relative_search_space(
        self, study: optuna.Study, trial: FrozenTrial
    ) -> dict[str, BaseDistribution]:
        """As the configured sampler."""
        return self._sampler.infer_relative_search_space(study, trial)

    def sample_relative(
        self, study: optuna.Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        """As the configured sampler."""
        return self._sampler.sample_relative(study, trial, search_space)

    def sample_independent(
        self, study: optuna.Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        """As the configured sampler."""
        return self._sampler.sample_independent(study, trial, param_name, param_distribution)


def build_pruner(settings: StudySettings, maximum_epochs: int) -> optuna.pruners.BasePruner:
    """The configured pruner, which judges the value after each epoch."""
    match settings.pruner:
        case Pruner.none:
            return optuna.pruners.NopPruner()
        case Pruner.median:
            return optuna.pruners.MedianPruner(
                n_startup_trials=settings.startup_trials, n_warmup_steps=settings.pruner_warmup_epochs
            )
        case Pruner.hyperband:
            return optuna.pruners.HyperbandPruner(
                min_resource=settings.pruner_warmup_epochs,
                max_resource=max(maximum_epochs, settings.pruner_warmup_epochs),
            )


def _build(settings: StudySettings, number: int) -> BaseSampler:
    seed = int(np.random.SeedSequence([settings.seed, number]).generate_state(1)[0])
    match settings.sampler:
        case SamplerKind.tpe:
            return optuna.samplers.TPESampler(n_startup_trials=settings.startup_trials, seed=seed)
        case SamplerKind.random:
            return optuna.samplers.RandomSampler(seed=seed)
