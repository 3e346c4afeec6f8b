"""Sample sizes of a controller's figures: seeds, episodes, training or planning budget; ours and the paper's."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from pipeline.reporting.results.controllers import TRAINED, ControllerResult
from pipeline.reporting.results.paper import ICEM_BUDGET, PAPER_EPISODES, PPO_EVALUATED_STEPS

MILLION = 1_000_000


class PlanningBudget(NamedTuple):
    """Planning budget; fields as in `metrics.json`.

    Attributes:
        samples: sequences drawn in the first optimisation step of a decision.
        iterations: optimisation steps per decision.
        horizon_entries: entries of a sequence.
        ticks_per_entry: ticks for which an entry is held; unknown for the paper.
    """

    samples: int
    iterations: int
    horizon_entries: int
    ticks_per_entry: int | None

    def __str__(self) -> str:
        held = f" of {self.ticks_per_entry} ticks" if self.ticks_per_entry is not None else ""
        return f"{self.samples} samples × {self.iterations} iterations × {self.horizon_entries} entries{held}"

    @property
    def cell(self) -> str:
        """Short form for a column: `500 × 12 × 20`."""
        held = f" of {self.ticks_per_entry} ticks" if self.ticks_per_entry is not None else ""
        return f"{self.samples} × {self.iterations} × {self.horizon_entries}{held}"

    @property
    def effort(self) -> int:
        """Simulated entries per decision."""
        return self.samples * self.iterations * self.horizon_entries


BUDGET_LEGEND = (
    "Budget: environment steps that a policy was trained for; of a planner, samples × optimisation steps × entries "
    "of a sequence."
)
PAPER_PLANNING = PlanningBudget(*ICEM_BUDGET, ticks_per_entry=None)


def steps_text(steps: float) -> str:
    """`32 M steps`."""
    return f"{steps / MILLION:.3g} M steps"


def budget_cell(group: Sequence[ControllerResult]) -> str:
    """Training steps or planning budget of our controllers for a column, one entry if the seeds agree."""
    return " / ".join(
        dict.fromkeys(
            steps_text(controller.meta["steps"])
            if controller.algorithm in TRAINED
            else planning_budget(controller.meta).cell
            for controller in group
        )
    )


def paper_budget_cell(algorithm: str, kind: str) -> str:
    """Training steps or planning budget of one of the paper's controllers for a column."""
    return steps_text(PPO_EVALUATED_STEPS[kind]) if algorithm == "ppo" else PAPER_PLANNING.cell


def counts_text(title: str, group: Sequence[ControllerResult]) -> str:
    """`PPO MLP Δq̇: 5 seeds, 500 episodes each, 32 M steps`."""
    budget = " / ".join(dict.fromkeys(map(_own_budget, group)))
    return f"{title}: {seeds_text(group)}, {episodes_text(group)} episodes each, {budget}"


def seeds_text(group: Sequence[ControllerResult]) -> str:
    """`5 seeds`."""
    return f"{len(group)} seed{'s' if len(group) > 1 else ''}"


def episodes_text(group: Sequence[ControllerResult]) -> str:
    """Episodes per seed, one entry if the seeds agree."""
    return " / ".join(dict.fromkeys(str(episodes(controller)) for controller in group))


def episodes(controller: ControllerResult) -> int:
    """Number of evaluation episodes."""
    return int(controller.metrics["n_episodes"])


def smaller_budget(group: Sequence[ControllerResult]) -> str:
    """Shortfall of our budget against the paper's of the same controller, as a clause; empty without a shortfall."""
    first = group[0]
    clauses = []
    if first.algorithm in TRAINED:
        published = PPO_EVALUATED_STEPS.get(first.kind) if first.algorithm == "ppo" else None
        steps = min(controller.meta["steps"] for controller in group)
        if published is not None and steps < published:
            clauses.append(f"{steps_text(steps)} of training instead of {steps_text(published)}")
    elif (planned := planning_budget(first.meta)).effort < PAPER_PLANNING.effort:
        clauses.append(f"plans of {planned} instead of {PAPER_PLANNING}")
    n_episodes = min(map(episodes, group))
    if n_episodes < PAPER_EPISODES:
        clauses.append(f"{n_episodes} episodes instead of {PAPER_EPISODES}")
    return ", ".join(clauses)


def planning_budget(planning: Mapping[str, int]) -> PlanningBudget:
    """Read the section `planning` of a planner's `metrics.json`."""
    return PlanningBudget(*(planning[key] for key in PlanningBudget._fields))


def _own_budget(controller: ControllerResult) -> str:
    if controller.algorithm in TRAINED:
        return steps_text(controller.meta["steps"])
    return str(planning_budget(controller.meta))
