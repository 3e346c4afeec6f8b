"""Section `search` of a profile: search spaces, the study, and the rule that selects a model."""

from dataclasses import dataclass

from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.search.search_space import SearchSpace
from pipeline.dynamics.search.selection import SelectionRule
from pipeline.errors import InputError
from pipeline.study.settings import StudySettings


@dataclass
class SearchConfig:
    """Section `search`.

    Attributes:
        n_trials: Number of hyper-parameter sets in a study, over all its workers.
        study: How trials are proposed, ended and handed on.
        spaces: Search space per parameterization; both targets share it.
        selection: Rule that selects a model among the trials.
        timed_calls: Number of model steps over which inference time is measured.
    """

    n_trials: int
    study: StudySettings
    spaces: dict[Parameterization, SearchSpace]
    selection: SelectionRule
    timed_calls: int

    def __post_init__(self) -> None:
        for name in ("n_trials", "timed_calls"):
            if getattr(self, name) < 1:
                raise InputError(f"search.{name} is {getattr(self, name)}; it must be at least 1")
        missing = [kind.value for kind in Parameterization if kind not in self.spaces]
        if missing:
            raise InputError(f"search.spaces has no {', '.join(missing)}; add a search space for it")
