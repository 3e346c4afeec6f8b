"""Measured time of one compiled model step on a single state, as in a controller that predicts step by step."""

import time
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel, Target
from pipeline.dynamics.model.fir.model import MEMBERS
from pipeline.dynamics.model.kinds import build_model
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.model.specify import Scales, specification_of
from pipeline.dynamics.settings import TrainingConfig
from pipeline.machine.specification import MachineSpecification

WARM_UP_SHARE = 0.1  # warm-up calls as a share of the timed calls, after the compilation


@dataclass(frozen=True)
class StepTime:
    """Distribution of the time of a call, in seconds, from the call to the result's being ready."""

    median_s: float
    lower_quartile_s: float
    upper_quartile_s: float
    n_calls: int


def unit_scale_model(
    machine: MachineSpecification,
    parameterization: Parameterization,
    target: Target,
    training: TrainingConfig,
    legendre_degree: int,
) -> DynamicsModel:
    """A model of this size with unit scales: time and size do not depend on the data."""
    scales = Scales(np.ones(machine.n_joint), np.ones(machine.n_joint), machine.lower, machine.upper)
    return build_model(specification_of(scales, machine, parameterization, target, training, legendre_degree))


def count_parameters(model: DynamicsModel) -> int:
    """Number of trained parameters of what is rolled out; an ensemble's members beside it do not count."""
    shapes = jax.eval_shape(model.initialise, jax.random.key(0))
    rolled = {name: of for name, of in shapes.items() if name != MEMBERS}
    return sum(leaf.size for leaf in jax.tree.leaves(rolled))


def time_step(model: DynamicsModel, n_calls: int) -> StepTime:
    """Measure `model.step` on one state; parameters are drawn, as their values do not matter.

    Each call waits for its result before the next.
    """
    parameters = model.initialise(jax.random.key(0))
    specification = model.specification
    middle = (np.asarray(specification.position_lower) + np.asarray(specification.position_upper)) / 2
    history = model.initial_history(jnp.asarray(middle, jnp.float32))
    command = jnp.zeros(specification.n_joint, jnp.float32)
    step = jax.jit(model.step)
    n_warm_up = 1 + round(WARM_UP_SHARE * n_calls)
    durations_ns = np.empty(n_warm_up + n_calls, np.int64)
    for call in range(n_warm_up + n_calls):
        start_ns = time.perf_counter_ns()
        jax.block_until_ready(step(parameters, history, command))
        durations_ns[call] = time.perf_counter_ns() - start_ns
    lower, median, upper = np.quantile(durations_ns[n_warm_up:], [0.25, 0.5, 0.75]) * 1e-9
    return StepTime(float(median), float(lower), float(upper), n_calls)
