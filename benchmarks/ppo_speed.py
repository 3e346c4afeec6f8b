"""How fast PPO's environment steps, beside the same task written plainly, and beside the processor's peak.

    python -m benchmarks.ppo_speed [--training] [--environments N] [--hidden 512 128]

Three measurements, on a Δq̇ MLP with lags 18 of random parameters, ticks (action repeats included) per second:

- environment: decisions under random proto-actions; observations kept, as PPO keeps them. Beside it the dynamics'
  network alone, one tick after the other, with nothing around it: what an environment that rolls all of the window
  cannot beat;
- collection: Brax's `generate_unroll` with the profile's policy network (the paper's by default), what PPO learns from;
- update: gradients of Brax's loss over the profile's minibatches, as often as a batch is learned from, so that all
  three say what a tick of training costs;
- training (`--training`): whole batches of Brax's PPO with the profile's networks and hyper-parameters.

Against it stands `ppo_speed_plain.py`: one tick of one machine, batched by `vmap`, under Brax's own training wrappers.
First it is checked that both give the same rewards and observations. Then they take turns in one process, so that
whatever else the machine does falls on both; best and median turn are printed, by the wall clock and by processor time
of the process (all its threads). The second is the one to compare by where other processes run.

Needed floating-point operations per tick: 2 Σ n_l n_{l+1} over the model's layers, and over the policy's divided by
the action repeats; the share of the peak is their rate over that of the best large float32 matrix product seen in the
same run. Of the model's first layer this project computes fewer (`dynamics/model/rollouts/held_command.py`): its share
is of what the plain way needs.
"""

import argparse
import dataclasses
import itertools
import os
import statistics
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from brax.envs import training as brax_wrappers
from brax.training import acting
from brax.training.acme import running_statistics, specs
from brax.training.agents.ppo import losses
from brax.training.agents.ppo import networks as ppo_networks
from brax.training.agents.ppo import train as ppo
from brax.training.types import Transition

from benchmarks.ppo_speed_plain import PlainEnvironment
from pipeline.configuration.load import MACHINE_DIRECTORY, ControlConfiguration, load_machine, load_section
from pipeline.control.ppo import PPOConfig
from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification, Parameterization, Target
from pipeline.dynamics.model.network import apply
from pipeline.machine.kinematics import load_arm
from pipeline.reaching.environment import ReachingEnvironment
from pipeline.reaching.episodes import EpisodesConfig, learning_poses
from pipeline.reaching.fresh_episodes import FreshEpisodes, fresh_episodes
from pipeline.reaching.reward import RewardConfig
from pipeline.reaching.task import ReachingTask

LAGS = 18  # paper, the selected Δq̇ MLP
TABLE_ROWS = 8192
PEAK_SIZE = 1024
SAME = 1e-3  # largest difference of rewards and observations after a few decisions, in float32
WARM_UP_EPOCHS = 1  # of training; compilation falls into it


def environments_of(hidden: list[int]) -> tuple[ReachingEnvironment, PlainEnvironment]:
    machine = load_machine("bobcat_e10")
    arm = load_arm(machine, MACHINE_DIRECTORY)
    model = DynamicsModel(
        ModelSpecification(
            parameterization=Parameterization.mlp,
            target=Target.dqdot,
            hidden=hidden,
            lags=LAGS,
            legendre_degree=1,
            joints=list(machine.joint_names),
            rate_hz=machine.rate_hz,
            position_lower=list(machine.lower),
            position_upper=list(machine.upper),
            velocity_limit=[0.5] * machine.n_joint,
            residual_scale=[0.02] * machine.n_joint,
        )
    )
    reward, episodes = load_section("reward", RewardConfig), load_section("episodes", EpisodesConfig)
    task = ReachingTask(machine, arm, model, model.initialise(jax.random.key(0)), reward)
    poses = learning_poses(machine, arm, dataclasses.replace(episodes, table_rows=TABLE_ROWS), seed=0)
    repeats = load_section("control", ControlConfiguration).action_repeats
    return ReachingEnvironment(task, poses, repeats, episodes.steps), PlainEnvironment(task, poses)


def check_equal(ours: ReachingEnvironment, plain: PlainEnvironment) -> None:
    """Both from the same keys under the same actions.

    Raises:
        SystemExit: they differ.
    """
    keys = jax.random.split(jax.random.PRNGKey(0), 64)
    states = jax.jit(jax.vmap(ours.reset))(keys), jax.jit(jax.vmap(plain.reset))(keys)
    step, tick = jax.jit(ours.step), jax.jit(jax.vmap(plain.step))
    a, b = states
    for action in jax.random.uniform(jax.random.key(1), (5, 64, ours.action_size), minval=-1.0):
        a, reward = step(a, action), 0.0
        for _ in range(ours.action_repeats):
            b = tick(b, action)
            reward = reward + b.reward
        worst = max(float(jnp.abs(a.obs - b.obs).max()), float(jnp.median(jnp.abs(a.reward - reward))))
        if worst > SAME:  # the median of rewards: a bonus at its threshold may fall either way
            raise SystemExit(f"the two environments differ by {worst:.1e}")


def stepping(environment: Any, n: int, n_decisions: int) -> Callable[[], Any]:
    actions = jax.random.uniform(jax.random.key(1), (n_decisions, n, environment.action_size), minval=-1.0)
    state = jax.jit(environment.reset)(jax.random.split(jax.random.PRNGKey(0), n))

    def advance(state: Any, action: jax.Array) -> tuple[Any, Any]:
        after = environment.step(state, action)
        return after, (state.obs, after.obs, after.reward)

    run = jax.jit(lambda state: jax.lax.scan(advance, state, actions))
    return lambda: run(state)


def network_alone(environment: ReachingEnvironment, n: int, n_ticks: int) -> Callable[[], Any]:
    """The dynamics' network on `n` windows, each tick's output in the next one's input."""
    task = environment.task
    network, parameters, n_joint = task.dynamics.network, task.parameters, environment.action_size
    windows = jax.random.normal(jax.random.key(1), (n, task.dynamics.specification.n_features))

    def advance(x: jax.Array, _: None) -> tuple[jax.Array, None]:
        return x.at[:, :n_joint].set(apply(network, parameters, x)), None

    run = jax.jit(lambda x: jax.lax.scan(advance, x, None, n_ticks)[0])
    return lambda: run(windows)


def collecting(environment: Any, n: int, n_decisions: int, config: PPOConfig) -> Callable[[], Any]:
    network = network_of(environment, config)
    statistic = running_statistics.init_state(
        specs.Array((environment.observation_size,), jnp.dtype("float32"))
    )
    policy_parameters = network.policy_network.init(jax.random.key(0))
    state = jax.jit(environment.reset)(jax.random.split(jax.random.PRNGKey(0), n))

    @jax.jit
    def run(state: Any, parameters: Any) -> Any:
        policy = ppo_networks.make_inference_fn(network)((statistic, parameters, None))
        return acting.generate_unroll(
            environment, state, policy, jax.random.PRNGKey(1), n_decisions, ("truncation",)
        )

    return lambda: run(state, policy_parameters)


def updating(environment: Any, config: PPOConfig) -> Callable[[], Any]:
    """The gradient of one minibatch of random data."""
    network = network_of(environment, config)
    statistic = running_statistics.init_state(
        specs.Array((environment.observation_size,), jnp.dtype("float32"))
    )
    shape = (config.batch_size, config.unroll_length)
    keys = jax.random.split(jax.random.key(2), 5)
    n_joint = environment.action_size
    data = Transition(
        observation=jax.random.normal(keys[0], (*shape, environment.observation_size)),
        action=jax.random.normal(keys[1], (*shape, n_joint)),
        reward=jax.random.normal(keys[2], shape),
        discount=jnp.ones(shape),
        next_observation=jax.random.normal(keys[3], (*shape, environment.observation_size)),
        extras={
            "state_extras": {"truncation": jnp.zeros(shape)},
            "policy_extras": {
                "raw_action": jax.random.normal(keys[1], (*shape, n_joint)),
                "log_prob": jax.random.normal(keys[4], shape),
                "distribution_params": jnp.zeros((*shape, 2 * n_joint)),
            },
        },
    )
    parameters = losses.PPONetworkParams(
        network.policy_network.init(keys[0]), network.value_network.init(keys[1])
    )

    @jax.jit
    def run(parameters: Any, data: Any) -> Any:
        return jax.grad(
            lambda p: losses.compute_ppo_loss(p, statistic, data, keys[2], ppo_network=network)[0]
        )(parameters)

    return lambda: run(parameters, data)


def network_of(environment: Any, config: PPOConfig) -> ppo_networks.PPONetworks:
    return ppo_networks.make_ppo_networks(
        environment.observation_size,
        environment.action_size,
        running_statistics.normalize,
        policy_hidden_layer_sizes=config.policy_hidden,
        value_hidden_layer_sizes=config.value_hidden,
    )


def training_rate(environment: Any, config: PPOConfig, wrap: Any, repeats: int, ticks: int) -> float:
    """Ticks per second of Brax's PPO after compilation."""
    batch = config.batch_size * config.minibatches * config.unroll_length * repeats
    rates: list[float] = []
    ppo.train(
        environment=environment,
        num_timesteps=2 * batch,
        wrap_env_fn=wrap,
        num_envs=config.environments,
        episode_length=ticks,
        action_repeat=repeats,
        learning_rate=config.learning_rate,
        entropy_cost=config.entropy_cost,
        discounting=config.discount,
        unroll_length=config.unroll_length,
        clipping_epsilon=config.clipping,
        batch_size=config.batch_size,
        num_minibatches=config.minibatches,
        num_updates_per_batch=config.updates_per_batch,
        normalize_observations=True,
        network_factory=lambda *a, **k: ppo_networks.make_ppo_networks(
            *a,
            policy_hidden_layer_sizes=config.policy_hidden,
            value_hidden_layer_sizes=config.value_hidden,
            **k,
        ),
        num_evals=3,
        run_evals=False,
        num_eval_envs=1,
        progress_fn=lambda _, metrics: rates.append(float(metrics["training/sps"])),
    )
    return max(rates[WARM_UP_EPOCHS:])


def take_turns(calls: dict[str, Callable[[], Any]], seconds: float) -> dict[str, tuple[list, list]]:
    """Wall and processor seconds of every turn; one turn each, round after round, for `seconds` in all."""
    times: dict[str, tuple[list, list]] = {name: ([], []) for name in calls}
    for call in calls.values():
        jax.block_until_ready(call())
    end = time.perf_counter() + seconds
    while time.perf_counter() < end or len(next(iter(times.values()))[0]) < 3:
        for name, call in calls.items():
            wall, processor = time.perf_counter(), time.process_time()
            jax.block_until_ready(call())
            times[name][0].append(time.perf_counter() - wall)
            times[name][1].append(time.process_time() - processor)
    return times


def operations(widths: list[int]) -> float:
    return 2.0 * sum(n_in * n_out for n_in, n_out in itertools.pairwise(widths))


def measure_update(environment: Any, config: PPOConfig, repeats: int, seconds: float) -> None:
    wall, processor = take_turns({"update": updating(environment, config)}, seconds / 2)["update"]
    ticks_per_update = config.batch_size * config.unroll_length * repeats / config.updates_per_batch
    print(
        f"\nupdate: {min(processor) * 1e3:.1f} ms of processor time, {min(wall) * 1e3:.1f} ms at best; per tick of "
        f"training {min(processor) / ticks_per_update * 1e6:.2f} us of processor time"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hidden", type=int, nargs="+", default=[512, 128], help="of the dynamics model")
    parser.add_argument("--environments", type=int, help="side by side; the profile's where not given")
    parser.add_argument("--profile", default="paper", help="whose networks and hyper-parameters")
    parser.add_argument("--decisions", type=int, default=20, help="per turn")
    parser.add_argument("--seconds", type=float, default=20.0, help="per measurement")
    parser.add_argument("--training", action="store_true", help="also whole batches of training")
    arguments = parser.parse_args()

    config = load_section("ppo", PPOConfig, arguments.profile)
    n = arguments.environments or config.environments
    ours, plain = environments_of(arguments.hidden)
    check_equal(ours, plain)
    repeats, ticks = ours.action_repeats, ours.episode_ticks
    wrapped = {
        "this project": FreshEpisodes(ours, config.staggered_episodes),
        "plain": brax_wrappers.wrap(plain, episode_length=ticks, action_repeat=repeats),
    }
    matrix = jnp.asarray(np.random.default_rng(0).normal(size=(PEAK_SIZE, PEAK_SIZE)), jnp.float32)
    product = jax.jit(lambda a: a @ a)
    n_joint = ours.action_size
    of_model = operations([ours.task.dynamics.specification.n_features, *arguments.hidden, n_joint])
    of_policy = operations([ours.observation_size, *config.policy_hidden, 2 * n_joint]) / repeats
    print(
        f"{jax.devices()[0].device_kind}, {len(os.sched_getaffinity(0))} processors, load {os.getloadavg()[0]:.1f}; "
        f"MLP{tuple(arguments.hidden)}, {n} environments"
    )
    measurements = {
        "environment": (
            of_model,
            {name: stepping(environment, n, arguments.decisions) for name, environment in wrapped.items()}
            | {"network alone": network_alone(ours, n, arguments.decisions * repeats)},
        ),
        "collection": (
            of_model + of_policy,
            {
                name: collecting(environment, n, arguments.decisions, config)
                for name, environment in wrapped.items()
            },
        ),
    }
    for title, (needed, calls) in measurements.items():
        times = take_turns({"peak": lambda: product(matrix), **calls}, arguments.seconds)
        peak = times.pop("peak")
        n_ticks = n * arguments.decisions * repeats
        for clock, index in (("wall clock", 0), ("processor time", 1)):
            peak_rate = 2.0 * PEAK_SIZE**3 / min(peak[index])
            print(
                f"\n{title}, {clock}; peak {peak_rate / 1e9:.0f} GFLOP/s, {needed / 1e3:.0f} kFLOP per tick"
            )
            for name, both in times.items():
                best, median = n_ticks / min(both[index]), n_ticks / statistics.median(both[index])
                print(
                    f"  {name:14s} {best:12,.0f} ticks/s best {median:12,.0f} median"
                    f" {best * needed / peak_rate:6.0%} of the peak"
                )
            first, second = (times[name][index] for name in wrapped)
            ratios = [b / a for a, b in zip(first, second, strict=True)]
            print(
                f"  this project / plain: best {min(second) / min(first):.2f}, median {statistics.median(ratios):.2f}"
            )
    measure_update(wrapped["this project"], config, repeats, arguments.seconds)
    if arguments.training:
        print("\ntraining, wall clock")
        for name, environment, wrap in (
            ("this project", ours, fresh_episodes(config.staggered_episodes)),
            ("plain", plain, None),
        ):
            rate = training_rate(environment, config, wrap, repeats, ticks)
            print(f"  {name:14s} {rate:12,.0f} ticks/s")


if __name__ == "__main__":
    main()
