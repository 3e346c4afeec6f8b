"""Section `search` of a profile: what is searched, how, and by which rule a model is selected from it."""

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
        n_trials: Hyper-parameter sets that a study tries, over all its workers.
        study: How.
        spaces: Per parameterization what is tried; the same for both targets.
        selection: Which of the tried models is selected.
        timed_calls: Calls of one model step that an inference time is measured over.
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
