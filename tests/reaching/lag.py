"""A stand-in for a learned model: every joint follows its command after a dead time, with a first-order lag."""

import jax
import jax.numpy as jnp

from pipeline.dynamics.features import History, push
from pipeline.dynamics.model import DynamicsModel, ModelSpecification, Parameterization, Target
from pipeline.dynamics.network import Parameters
from pipeline.machine.specification import MachineSpecification

FULL_SPEED = 0.5  # rad/s
TIME_CONSTANT_S = 0.5
DEAD_TICKS = 3


class LagDynamics(DynamicsModel):
    """v += dt/tau (speed a_{t-dead} - v), q += dt v, with the window and the features of a Δq̇ model."""

    def step(self, parameters: Parameters, history: History, command: jax.Array) -> History:
        del parameters
        commands = push(history.commands, command)
        newest = history.motion[..., -1, :]
        dt_s = self.specification.dt_s
        v = newest + dt_s / TIME_CONSTANT_S * (FULL_SPEED * commands[..., -1 - DEAD_TICKS, :] - newest)
        return History(motion=push(history.motion, v), commands=commands, q=history.q + dt_s * v)


def model_specification(machine: MachineSpecification, target: Target, lags: int) -> ModelSpecification:
    return ModelSpecification(
        parameterization=Parameterization.mlp,
        target=target,
        hidden=[16],
        lags=lags,
        legendre_degree=3,
        joints=list(machine.joint_names),
        rate_hz=machine.rate_hz,
        position_lower=list(machine.lower),
        position_upper=list(machine.upper),
        velocity_limit=[1.0] * machine.n_joint,
        residual_scale=[0.02] * machine.n_joint,
    )


def lag_dynamics(machine: MachineSpecification) -> LagDynamics:
    return LagDynamics(model_specification(machine, Target.dqdot, lags=6))


def random_configurations(machine: MachineSpecification, key: jax.Array, n: int) -> jax.Array:
    lower, upper = jnp.asarray(machine.lower), jnp.asarray(machine.upper)
    return jax.random.uniform(key, (n, machine.n_joint), minval=lower, maxval=upper)
