"""A small machine, rows to learn from, and one small model of each kind."""

import jax
import numpy as np
import pytest

from pipeline.dynamics.model.dynamics_model import DynamicsModel, ModelSpecification
from pipeline.dynamics.model.fir.specification import FirSpecification
from pipeline.dynamics.settings import IdentifyConfig, Optimiser, TrainingConfig
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import JointKind, JointSpecification, MachineSpecification

KINDS = [("mlp", "dq"), ("mlp", "dqdot"), ("kan", "dq"), ("kan", "dqdot")]
LAGS = 3


def make_specification(parameterization, target, lags=LAGS, hidden=(5, 4)) -> ModelSpecification:
    return ModelSpecification(
        parameterization=parameterization,
        target=target,
        hidden=list(hidden),
        lags=lags,
        legendre_degree=4,
        joints=["lift", "slide"],
        rate_hz=20.0,
        position_lower=[-1.0, 0.05],
        position_upper=[0.5, 0.3],
        velocity_limit=[0.7, 0.1],
        residual_scale=[0.02, 0.003],
    )


def make_fir_specification(limit: float, speed: np.ndarray, lags: int, **changes) -> FirSpecification:
    """Joints between ± limit, at this usual speed; stops are nowhere."""
    n_joint = len(speed)
    values = vars(make_specification("mlp", "dqdot", lags)) | {
        "parameterization": "nfir",
        "joints": [f"joint_{number}" for number in range(n_joint)],
        "position_lower": [-limit] * n_joint,
        "position_upper": [limit] * n_joint,
        "velocity_limit": list(speed),
        "residual_scale": list(speed),
        "members": 2,
        "member_hidden": [4],
        "demand_beyond": [],
        "stop_lower": [None] * n_joint,
        "stop_upper": [None] * n_joint,
    }
    return FirSpecification(**(values | changes))


def make_trajectory(q, qd, a, n_validation=0, name="log") -> Trajectory:
    n_rows = len(q)
    t_s = 0.05 * np.arange(n_rows)
    return Trajectory(
        name=name,
        t_s=t_s,
        stamp_ns=(1e9 * t_s).astype(np.int64),
        q=np.asarray(q, np.float64),
        qd=np.asarray(qd, np.float64),
        a=np.asarray(a, np.float64),
        is_validation=np.arange(n_rows) >= n_rows - n_validation,
    )


def random_trajectory(seed, n_rows, n_validation=0, n_joint=2) -> Trajectory:
    random = np.random.default_rng(seed)
    return make_trajectory(
        q=random.uniform(-0.5, 0.5, (n_rows, n_joint)),
        qd=random.uniform(-0.5, 0.5, (n_rows, n_joint)),
        a=random.integers(-1, 2, (n_rows, n_joint)),
        n_validation=n_validation,
    )


def lag_trajectory(seed, n_rows, n_validation) -> Trajectory:
    """Two joints that follow their commands with a first-order lag and a dead time of two steps, within ±1."""
    random = np.random.default_rng(seed)
    a, q, v = np.zeros((n_rows, 2)), np.zeros((n_rows, 2)), np.zeros((n_rows, 2))
    for t in range(n_rows - 1):
        a[t] = random.integers(-1, 2, 2) if t % 10 == 0 else a[t - 1]
        a[t] = np.where(np.abs(q[t]) > 0.6, -np.sign(q[t]), a[t])
        late = a[t - 2] if t >= 2 else np.zeros(2)
        v[t + 1] = v[t] + 0.2 * (np.array([0.5, 0.3]) * late - v[t])
        q[t + 1] = q[t] + 0.05 * v[t + 1]
    return make_trajectory(q, v, a, n_validation=n_validation, name=f"lag{seed}")


def make_identify(**changes) -> IdentifyConfig:
    values = {
        "seed": 3,
        "evaluation_horizon": 20,
        "evaluation_windows": 30,
        "patience_evaluations": 50,
        "optimiser": Optimiser.adam,
        "gradient_clip": None,
        "cosine_decay": False,
        "batches_per_epoch": None,
        "checkpoint_every_epochs": 1,
        "legendre_degree": 3,
        "velocity_limit_quantile": 0.999,
        "long_prediction_steps": 150,
        "arx_ridge": 1e-6,
        "selected": {},
    }
    return IdentifyConfig(**(values | changes))


def make_training(**changes) -> TrainingConfig:
    values = {
        "hidden": [16],
        "lags": 4,
        "horizon": 4,
        "learning_rate": 3e-3,
        "batch_size": 64,
        "maximum_epochs": 5,
    }
    return TrainingConfig(**(values | changes))


@pytest.fixture(scope="session")
def machine() -> MachineSpecification:
    return MachineSpecification(
        name="two_joints",
        rate_hz=20.0,
        joints=[
            JointSpecification("lift", -1.0, 1.0),
            JointSpecification("turn", -1.0, 1.0, JointKind.revolute),
        ],
    )


@pytest.fixture(scope="session")
def lag_trajectories() -> list[Trajectory]:
    return [lag_trajectory(seed, n_rows=700, n_validation=150) for seed in (0, 1)]


@pytest.fixture(scope="session", params=KINDS, ids="_".join)
def model(request) -> DynamicsModel:
    """Each of the four kinds."""
    return DynamicsModel(make_specification(*request.param))


@pytest.fixture(scope="session")
def parameters(model):
    return move_biases(model.initialise(jax.random.key(0)))


@pytest.fixture(scope="session")
def one_model() -> DynamicsModel:
    """One kind, for what does not depend on the kind."""
    return DynamicsModel(make_specification("mlp", "dqdot"))


@pytest.fixture(scope="session")
def one_models_parameters(one_model):
    return move_biases(one_model.initialise(jax.random.key(0)))


def move_biases(drawn):
    """Parameters with biases moved away from zero, so that they count, as float64 NumPy arrays."""
    random = np.random.default_rng(0)
    return jax.tree.map(lambda leaf: np.asarray(leaf, np.float64) + random.normal(0, 0.1, leaf.shape), drawn)
