"""A stand-in for a learned model: every joint follows its command after a dead time, with a first-order lag."""

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification, Parameterization, Target
from pipeline.dynamics.model.network import Layer, MultilayerPerceptron, Parameters
from pipeline.machine.specification import MachineSpecification

FULL_SPEED = 0.5  # rad/s
TIME_CONSTANT_S = 0.5
DEAD_TICKS = 3


class LagDynamics(DynamicsModel):
    """v += dt/tau (speed a_{t-dead} - v), q += dt v, as a Δq̇ model whose network is written down."""

    def __init__(self, specification: ModelSpecification) -> None:
        super().__init__(specification)
        self.network = LagNetwork(specification)


class LagNetwork(MultilayerPerceptron):
    """The linear map of the lag as an MLP: SiLU(x) - SiLU(-x) = x."""

    def __init__(self, specification: ModelSpecification) -> None:
        n, share = specification.n_joint, specification.dt_s / TIME_CONSTANT_S
        super().__init__(specification.n_features, [2 * n], n)
        newest = slice(specification.lags * n, (specification.lags + 1) * n)
        acting = slice(
            (2 * specification.lags + 1 - DEAD_TICKS) * n, (2 * specification.lags + 2 - DEAD_TICKS) * n
        )
        linear = np.zeros((specification.n_features, n), np.float32)
        linear[newest] = -share * np.diag(specification.velocity_limit)
        linear[acting] = share * FULL_SPEED * np.eye(n)
        linear /= specification.residual_scale
        both_signs = np.concatenate([np.eye(n), -np.eye(n)]).astype(np.float32)
        self._layers = [
            Layer(jnp.asarray(linear @ both_signs.T), jnp.zeros(2 * n)),
            Layer(jnp.asarray(both_signs), jnp.zeros(n)),
        ]

    def layers(self, parameters: Parameters) -> list[Layer]:
        del parameters
        return self._layers


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
