"""iCEM plans through the fixed episodes, on the model that it plans with."""

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.control.checkpoint import identity
from pipeline.control.chunks import evaluate_in_chunks
from pipeline.control.evaluate import controller_evaluation
from pipeline.control.icem.config import IcemConfig
from pipeline.control.icem.controller import icem_controller
from pipeline.control.icem.variant import RewardVariant, variant_reward
from pipeline.effects.store import load_dynamics
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.metrics import Traces, reaching_metrics
from pipeline.reaching.reward import total_reward
from pipeline.reaching.settings import ReachingSettings


def evaluate_planner(
    model: Path,
    reaching: ReachingSettings,
    icem: IcemConfig,
    variant: RewardVariant,
    episodes: Episodes,
    seed: int,
    progress: Callable[[int], None] = lambda n: None,
    checkpoints: Path | None = None,
) -> tuple[Traces, dict[str, Any]]:
    """Plan through every episode with one of the paper's rewards.

    Args:
        model: Folder of the model.
        reaching: The task, with the policies' reward, whose return stands beside that of the reward planned with.
        icem: Section `icem` of a profile.
        variant: Reward that is planned with.
        episodes: Starts and targets.
        seed: Of the samples.
        progress: Called with the number of episodes done since the last call.
        checkpoints: Folder from which a killed evaluation goes on; None: it does not.

    Returns:
        Traces of all episodes, and metrics: those of reaching, the return of the full reward, what is planned over.
    """
    repeats, steps = reaching.action_repeats, reaching.episodes.steps
    dynamics, parameters = load_dynamics(model)
    # The return is that of the reward planned with, as in the paper's table; see docs/controllers.md.
    reward = variant_reward(reaching.reward, variant)
    task = reaching.task(dynamics, parameters, reward)
    evaluate = controller_evaluation(icem_controller(task, icem, repeats), task, repeats, steps)
    specification = asdict(reaching.machine), asdict(dynamics.specification), parameters
    evaluation = identity(asdict(icem), asdict(reward), specification, (repeats, steps, seed), episodes)
    traces, terms = evaluate_in_chunks(
        lambda chunk, keys: evaluate(None, chunk, keys),
        episodes,
        seed,
        icem.chunk_episodes,
        checkpoints,
        evaluation,
        progress,
    )
    full = np.asarray(total_reward(reaching.reward, terms))
    metrics = {
        **reaching_metrics(traces, task.arm.surfaces).as_dict(),
        "average_return_full_reward": float(full.sum(axis=1, dtype=np.float64).mean()),
        "planning": {
            "horizon_entries": icem.horizon,
            "ticks_per_entry": icem.ticks_per_entry(repeats),
            "samples": icem.samples,
            "elites": icem.elites,
            "iterations": icem.iterations,
            "sequences_per_decision": icem.sequences_per_decision,
        },
    }
    return traces, metrics
