"""Trains a small model with checkpoints, says each epoch, and writes the parameters; test_killed_training.py."""

import sys
from pathlib import Path

import jax
import numpy as np

from pipeline.dynamics.model.dynamics_model import Target
from pipeline.dynamics.model.network import Parameterization
from pipeline.dynamics.training.fit import FitResult, fit
from pipeline.machine.specification import JointSpecification, MachineSpecification
from tests.dynamics.conftest import lag_trajectory, make_identify, make_training


def train(checkpoints: Path | None, progress=None) -> FitResult:
    joints = [JointSpecification("lift", -1.0, 1.0), JointSpecification("turn", -1.0, 1.0)]
    return fit(
        [lag_trajectory(seed, n_rows=700, n_validation=150) for seed in (0, 1)],
        MachineSpecification(name="two_joints", rate_hz=20.0, joints=joints),
        Parameterization.mlp,
        Target.dqdot,
        make_training(maximum_epochs=25),
        make_identify(),
        seed=0,
        progress=progress,
        checkpoint_directory=checkpoints,
    )


if __name__ == "__main__":
    cache, checkpoints, output = sys.argv[1:]
    jax.config.update("jax_compilation_cache_dir", cache)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    result = train(Path(checkpoints), progress=lambda epoch, *_: print(epoch, flush=True))
    np.savez(output, *jax.tree.leaves(result.parameters), **result.curves)
