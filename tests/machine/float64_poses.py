"""Computes poses of configurations in float64; run as a program by the kinematics test.

Arguments: the folder conf/machine and a folder with `q.npy`, shape (n, 4), where `poses.npz` is written.
"""

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from pipeline.configuration.load import load_machine
from pipeline.machine.kinematics import load_arm

if __name__ == "__main__":
    machine_directory, folder = Path(sys.argv[1]), Path(sys.argv[2])
    arm = load_arm(load_machine("bobcat_e10"), machine_directory)
    pose = jax.jit(arm.forward)(jnp.asarray(np.load(folder / "q.npy")))
    np.savez(folder / "poses.npz", position=pose.position, quaternion=pose.quaternion)
