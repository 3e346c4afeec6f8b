"""The training: batches of episodes go on from where they were, and every few decisions the policy is improved."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from pipeline.control.apg.config import APGConfig
from pipeline.control.apg.network import as_policy, error_inputs, initial_layers, layers_of
from pipeline.control.apg.rollout import Between, discounted_cost
from pipeline.control.checkpoint import restored_like
from pipeline.control.curve import CurvePoint
from pipeline.control.policy import Policy, PolicyLayer
from pipeline.control.training import LearningCurve, TrainingResult
from pipeline.machine.specification import CommandKind
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import Episodes
from pipeline.reaching.fresh_episodes import where_over
from pipeline.reaching.task import TaskState

Layers = Sequence[PolicyLayer]


class PolicyTrainingState(NamedTuple):
    """All that a training knows between two updates; arrays.

    Attributes:
        layers: trained ones.
        optimiser: Adam's moments.
        average: of the layers.
        episodes: under way, (environments, ...).
        clock: decisions since each of them began, (environments,).
        n_updates: so far. The random numbers of an update depend on the seed and on this alone.
    """

    layers: Layers
    optimiser: Any
    average: Layers
    episodes: TaskState
    clock: jax.Array
    n_updates: jax.Array


class Trainer:
    """Updates of a policy; pure functions of their state."""

    def __init__(
        self,
        environment: ReachingEnvironment,
        config: APGConfig,
        seed: int,
        n_updates: int,
        start: Policy | None = None,
    ) -> None:
        """Prepares `n_updates` updates of the configuration, from a policy or from random weights."""
        self._environment, self._config, self._n_updates = environment, config, n_updates
        self._start = start
        self._key = jax.random.key(seed)
        self.inputs = error_inputs(environment.task, config.error_gain)
        rate = optax.warmup_cosine_decay_schedule(
            0.0,
            config.learning_rate,
            min(config.warm_up_updates, n_updates - 1),
            n_updates,
            config.final_learning_rate,
        )
        self._optimiser = optax.chain(
            optax.clip_by_global_norm(config.gradient_norm), optax.adam(rate, b2=config.second_moment_decay)
        )

    def begin(self) -> PolicyTrainingState:
        """The first weights, and episodes with clocks spread evenly over an episode."""
        environment, n = self._environment, self._config.environments
        layers_key, episodes_key = jax.random.split(jax.random.fold_in(self._key, self._n_updates))
        if self._start is None:
            size, n_action = environment.observation_size, environment.action_size
            layers = initial_layers(layers_key, size, self._config.hidden, n_action)
        else:
            layers = layers_of(self._start, self.inputs)
        return PolicyTrainingState(
            layers=layers,
            optimiser=self._optimiser.init(layers),
            average=layers,
            episodes=self._fresh(episodes_key),
            clock=jnp.arange(n) * self._decisions // n,
            n_updates=jnp.zeros((), jnp.int32),
        )

    def update(self, state: PolicyTrainingState, _: None = None) -> tuple[PolicyTrainingState, jax.Array]:
        """One step along the gradient of `horizon` decisions of every episode; also the mean cost before it."""
        config = self._config
        noise_key, episodes_key = jax.random.split(jax.random.fold_in(self._key, state.n_updates))
        share = state.n_updates / self._n_updates
        deviation = config.noise + share * (config.final_noise - config.noise)
        shape = (config.horizon, config.environments, self._environment.action_size)
        noise = deviation * jax.random.normal(noise_key, shape)
        between = None
        if config.between and self._environment.task.machine.command_kind is CommandKind.discrete:
            between = Between.draw(jax.random.fold_in(noise_key, 0), *shape[1:])

        def cost(layers: Layers) -> tuple[jax.Array, TaskState]:
            environment, policy = self._environment, as_policy(layers, self.inputs)
            task, repeats = environment.task, environment.action_repeats
            return discounted_cost(config, task, repeats, policy, state.episodes, noise, between)

        (value, episodes), gradient = jax.value_and_grad(cost, has_aux=True)(state.layers)
        step, optimiser = self._optimiser.update(gradient, state.optimiser)
        layers = optax.apply_updates(state.layers, step)
        clock = state.clock + config.horizon
        over = clock >= self._decisions
        return PolicyTrainingState(
            layers=layers,
            optimiser=optimiser,
            average=jax.tree.map(partial(_averaged, config.averaging), state.average, layers),
            episodes=jax.tree.map(partial(where_over, over), self._fresh(episodes_key), episodes),
            clock=jnp.where(over, 0, clock),
            n_updates=state.n_updates + 1,
        ), value

    @property
    def _decisions(self) -> int:
        return self._environment.episode_ticks // self._environment.action_repeats

    def _fresh(self, key: jax.Array) -> TaskState:
        keys = jax.random.split(key, self._config.environments)
        return jax.vmap(lambda key: self._environment.new_episode(key).task)(keys)


def train(
    environment: ReachingEnvironment,
    config: APGConfig,
    seed: int,
    episodes: Episodes,
    progress: Callable[[CurvePoint], None],
    checkpoint_directory: Path | None,
    start: Policy | None = None,
) -> TrainingResult:
    """Train a policy, or train `start` further; else as `pipeline.control.ppo.train`, its checkpoints and result, too.

    The kept policy is that of the last point of the curve.

    Raises:
        InputError: the training diverged, or the checkpoint is broken.
    """
    steps_per_update = config.environments * config.horizon * environment.action_repeats
    n_per_point = -(-config.training_steps // (config.curve_points * steps_per_update))
    trainer = Trainer(environment, config, seed, config.curve_points * n_per_point, start)
    curve = LearningCurve("apg", environment, config, seed, episodes, progress, checkpoint_directory, start)
    state = jax.jit(trainer.begin)()
    if curve.resumed and curve.resumed.state is not None:
        state = restored_like(state, curve.resumed.state)

    run = jax.jit(lambda state: jax.lax.scan(trainer.update, state, length=n_per_point)[0])
    while len(curve.points) <= config.curve_points:
        if curve.points:
            state = run(state)
        steps = len(curve.points) * n_per_point * steps_per_update
        curve.measure(steps, as_policy(state.average, trainer.inputs))
        curve.save([np.asarray(leaf) for leaf in jax.tree.leaves(state)], None)
    return TrainingResult(as_policy(state.average, trainer.inputs), curve.points[-1].steps, curve.points)


def _averaged(share: float, old: jax.Array, new: jax.Array) -> jax.Array:
    return share * old + (1.0 - share) * new
