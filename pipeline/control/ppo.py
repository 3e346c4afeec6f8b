"""Proximal policy optimisation with Brax's implementation (paper, "RL-based controller")."""

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

import pipeline.machine.quiet_mjx  # noqa: F401 # isort: skip (before Brax)
from brax.training.agents.ppo import networks as ppo_networks
from brax.training.agents.ppo import train as ppo

from pipeline.control.curve import CurvePoint
from pipeline.control.policy import Policy, policy_from_brax
from pipeline.control.training import LearningCurve, TrainingResult
from pipeline.control.training_state import Epochs
from pipeline.control.warm_start import WarmStartConfig, policy_to_brax
from pipeline.dynamics.model.dynamics_model import ModelSpecification, Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.errors import InputError
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.fresh_episodes import fresh_episodes


@dataclass
class ModelKindOverrides:
    """What is other than in the rest of the section when the model is of one kind; null: nothing.

    The paper lowers the learning rate and trains longer on KAN Δq̇ (footnote of Table "Evaluation results").
    """

    training_steps: int | None = None
    evaluated_at_steps: int | None = None
    learning_rate: float | None = None
    final_learning_rate: float | None = None


@dataclass
class PPOConfig:
    """Section `ppo` of a profile.

    Steps are ticks of the environment, action repeats included, as the paper and Brax count them.

    Attributes:
        training_steps: at least so many; Brax rounds up to whole batches between two points of the curve.
        evaluated_at_steps: the policy of the first point of the curve at or after it is kept.
        learning_rate: of Adam, at the start.
        final_learning_rate: at `training_steps`, linear in between; equal to `learning_rate` for a constant
            one.
        entropy_cost: weight of the entropy bonus.
        discount: γ, per decision.
        gae_lambda: λ of generalised advantage estimation.
        unroll_length: decisions per sequence of a batch.
        clipping: ε of the clipped objective.
        batch_size: sequences per minibatch.
        minibatches: minibatches per batch.
        updates_per_batch: passes over a batch.
        environments: episodes that run side by side.
        staggered_episodes: spread the episodes' time-outs evenly in time instead of all at once.
        policy_hidden: units of the policy's hidden layers (SiLU).
        value_hidden: units of the critic's hidden layers (SiLU).
        normalize_observations: by running mean and standard deviation.
        reward_scaling: factor on rewards.
        curve_points: points of the learning curve after the first, evenly spaced.
        curve_episodes: fixed episodes that each point is measured over.
        model_kinds: overrides per `<parameterization>_<target>` of the model; see `for_model`.
    """

    training_steps: int
    evaluated_at_steps: int
    learning_rate: float
    final_learning_rate: float
    entropy_cost: float
    discount: float
    gae_lambda: float
    unroll_length: int
    clipping: float
    batch_size: int
    minibatches: int
    updates_per_batch: int
    environments: int
    staggered_episodes: bool
    policy_hidden: list[int]
    value_hidden: list[int]
    normalize_observations: bool
    reward_scaling: float
    curve_points: int
    curve_episodes: int
    model_kinds: dict[str, ModelKindOverrides] = field(default_factory=dict)

    def __post_init__(self) -> None:
        positive = (
            "training_steps learning_rate final_learning_rate unroll_length clipping batch_size minibatches "
            "updates_per_batch environments reward_scaling curve_points curve_episodes"
        )
        for name in positive.split():
            if not getattr(self, name) > 0:
                raise InputError(f"ppo.{name} is {getattr(self, name)}; it must be positive")
        for name in ("discount", "gae_lambda"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise InputError(f"ppo.{name} is {getattr(self, name)}; it must be in [0, 1]")
        if not 0 < self.evaluated_at_steps <= self.training_steps:
            raise InputError(
                f"ppo.evaluated_at_steps is {self.evaluated_at_steps}; it must be positive and not above "
                f"ppo.training_steps ({self.training_steps})"
            )
        if self.batch_size * self.minibatches % self.environments:
            raise InputError(
                f"ppo.batch_size * ppo.minibatches = {self.batch_size * self.minibatches} is no multiple of "
                f"ppo.environments = {self.environments}"
            )
        for name in ("policy_hidden", "value_hidden"):
            if not getattr(self, name) or min(getattr(self, name)) < 1:
                raise InputError(f"ppo.{name} is {getattr(self, name)}; list the units of at least one layer")
        kinds = [f"{parameterization}_{target}" for parameterization in Parameterization for target in Target]
        for kind in self.model_kinds:
            if kind not in kinds:
                raise InputError(f"ppo.model_kinds has {kind}; a kind of model is one of {', '.join(kinds)}")

    def for_model(self, specification: ModelSpecification) -> "PPOConfig":
        """The hyper-parameters for a model of this kind: those of the section, overridden by `model_kinds`.

        Raises:
            InputError: the overrides do not fit the rest of the section.
        """
        overrides = self.model_kinds.get(specification.kind, ModelKindOverrides())
        changed = {name: value for name, value in vars(overrides).items() if value is not None}
        return replace(self, model_kinds={}, **changed)

    def from_policy(self, start: Policy, warm_start: WarmStartConfig) -> "PPOConfig":
        """The hyper-parameters where `start` is trained further, with networks as wide as its own."""
        return replace(
            self,
            training_steps=warm_start.training_steps,
            evaluated_at_steps=warm_start.training_steps,
            learning_rate=warm_start.learning_rate,
            final_learning_rate=warm_start.final_learning_rate,
            policy_hidden=[len(layer.bias) for layer in start.layers[:-1]],
            normalize_observations=False,  # the policy's own becomes part of its first layer
            model_kinds={},
        )


class LinearDecay:
    """Learning rate that falls linearly with Adam's count of updates.

    Brax hands its `learning_rate` to Adam, which takes a schedule, but also reports
    `jnp.array(learning_rate)`; as an array this stands for the initial value.
    """

    def __init__(self, initial: float, final: float, n_updates: int) -> None:
        """Decay over `n_updates`."""
        self._initial, self._final, self._n_updates = initial, final, n_updates

    def __call__(self, count: jax.Array) -> jax.Array:
        """Rate of the update after `count` updates."""
        share = jnp.clip(count / self._n_updates, 0.0, 1.0)
        return self._initial + share * (self._final - self._initial)

    def __jax_array__(self) -> jax.Array:
        return jnp.asarray(self._initial)


def train(
    environment: ReachingEnvironment,
    config: PPOConfig,
    seed: int,
    episodes: Episodes,
    progress: Callable[[CurvePoint], None],
    checkpoint_directory: Path | None,
    start: tuple[Policy, float] | None = None,
) -> TrainingResult:
    """Train a policy.

    With a checkpoint directory, every point of the curve is saved, and a training that finds the checkpoint of an
    interrupted one of the same configuration, seed and task goes on from it, and ends as if it had not been
    interrupted (`training_state`).

    Args:
        environment: what to learn on.
        config: hyper-parameters.
        seed: of everything random.
        episodes: what the points of the curve are measured over, `config.curve_episodes` or more.
        progress: called with every new point of the curve.
        checkpoint_directory: where checkpoints go, or None.
        start: a policy that is trained further, and the deviation of its noise at first; None: random weights. The
            critic begins with random weights. `config` is then that of `PPOConfig.from_policy`.

    Returns:
        The kept policy and the curve.

    Raises:
        InputError: the training diverged, or the checkpoint is broken.
    """
    curve = LearningCurve(
        "ppo", environment, config, seed, episodes, progress, checkpoint_directory, start and start[0]
    )
    resumed, points = curve.resumed, curve.points
    kept: tuple[Policy, int] | None = resumed.kept if resumed else None
    epochs = Epochs(len(points) - 1, resumed.state) if resumed else Epochs(0, None)

    def record(steps: int, _: Any, parameters: tuple[Any, ...]) -> None:
        nonlocal kept
        if points and steps <= points[-1].steps:
            return  # done before the training was interrupted
        policy = policy_from_brax(parameters[0], parameters[1], config.normalize_observations)
        curve.measure(steps, policy)
        if kept is None and steps >= config.evaluated_at_steps:
            kept = policy, steps
        curve.save(epochs.saved(), kept)

    if not points or points[-1].steps < config.training_steps:
        with epochs.taking_over():
            _run_brax(environment, config, seed, record, start)
    assert kept is not None  # evaluated_at_steps <= training_steps <= steps of the last point
    return TrainingResult(kept[0], kept[1], points)


def _network_factory(config: PPOConfig) -> Callable[..., ppo_networks.PPONetworks]:
    return functools.partial(
        ppo_networks.make_ppo_networks,
        policy_hidden_layer_sizes=tuple(config.policy_hidden),
        value_hidden_layer_sizes=tuple(config.value_hidden),
    )


def _run_brax(
    environment: ReachingEnvironment,
    config: PPOConfig,
    seed: int,
    record: Callable[[int, Any, tuple[Any, ...]], None],
    start: tuple[Policy, float] | None,
) -> None:
    steps_per_batch = (
        config.batch_size * config.minibatches * config.unroll_length * environment.action_repeats
    )
    updates_per_batch = config.minibatches * config.updates_per_batch
    n_batches_per_point = -(-config.training_steps // (config.curve_points * steps_per_batch))
    steps_per_point = n_batches_per_point * steps_per_batch
    n_points = -(-config.training_steps // steps_per_point)
    learning_rate: Any = config.learning_rate
    if config.final_learning_rate != config.learning_rate:
        learning_rate = LinearDecay(
            config.learning_rate,
            config.final_learning_rate,
            config.training_steps // steps_per_batch * updates_per_batch,
        )
    ppo.train(
        environment=environment,
        num_timesteps=n_points * steps_per_point,
        wrap_env_fn=fresh_episodes(config.staggered_episodes),
        num_envs=config.environments,
        episode_length=environment.episode_ticks,
        action_repeat=environment.action_repeats,
        learning_rate=learning_rate,
        entropy_cost=config.entropy_cost,
        discounting=config.discount,
        gae_lambda=config.gae_lambda,
        unroll_length=config.unroll_length,
        clipping_epsilon=config.clipping,
        batch_size=config.batch_size,
        num_minibatches=config.minibatches,
        num_updates_per_batch=config.updates_per_batch,
        normalize_observations=config.normalize_observations,
        reward_scaling=config.reward_scaling,
        network_factory=_network_factory(config),
        seed=seed,
        num_evals=n_points + 1,
        run_evals=False,  # `record` measures the curve
        num_eval_envs=1,
        policy_params_fn=record,
        restore_params=None if start is None else policy_to_brax(*start),
        restore_value_fn=False,
    )
