"""A model of a simple machine, and logs of the same machine after one joint has become slower."""

import dataclasses
from functools import cache

import numpy as np
import pytest

from pipeline.discrepancy.baselines.continued_training import BaselinesConfig
from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.training.fit import FitResult, fit
from pipeline.logs.tuples import Trajectory
from pipeline.machine.specification import JointSpecification, MachineSpecification
from tests.dynamics.conftest import KINDS, lag_trajectory, make_identify, make_training

MACHINE = MachineSpecification(
    name="two_joints",
    rate_hz=20.0,
    joints=[JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -1.0, 1.0)],
)

# KANs compile for tens of seconds.
TRAINED_KINDS = [
    pytest.param(kind, id="_".join(kind), marks=pytest.mark.long if kind[0] == "kan" else [])
    for kind in KINDS
]


def make_settings(**changes) -> BaselinesConfig:
    values = {
        "learning_rates": [1e-3, 5e-3],
        "horizon": 8,
        "batch_size": 64,
        "batches_per_epoch": 15,
        "maximum_epochs": 8,
        "patience_evaluations": 8,
        "gradient_clip": 1.0,
        "evaluation_horizon": 40,
        "evaluation_windows": 50,
    }
    return BaselinesConfig(**(values | changes))


@cache
def nominal(parameterization: Parameterization, target: Target) -> FitResult:
    logs = [lag_trajectory(seed, n_rows=700, n_validation=150) for seed in (0, 1)]
    training = make_training(learning_rate=1e-2, maximum_epochs=10, horizon=8)
    return fit(logs, MACHINE, parameterization, target, training, make_identify(), seed=0)


def slower(seed: int, n_rows: int, n_validation: int = 0) -> Trajectory:
    """The joint `lift` moves at half its speed."""
    log = lag_trajectory(seed, n_rows, n_validation)
    return dataclasses.replace(log, q=log.q * np.array([0.5, 1.0]), qd=log.qd * np.array([0.5, 1.0]))
