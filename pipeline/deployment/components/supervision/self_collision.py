"""Distance between links that are not neighbours, from the shapes of the robot description."""

from itertools import combinations
from pathlib import Path

import mujoco
import numpy as np

from pipeline.machine.chain import urdf_path
from pipeline.machine.description import compile_urdf, read_urdf
from pipeline.machine.specification import MachineSpecification


class SelfCollision:
    """The arm's shapes, between which MuJoCo measures distances.

    Links that are connected by a joint touch by design and are not compared; shapes of fixed links belong to the
    link that carries them.
    """

    def __init__(self, machine: MachineSpecification, directory: Path) -> None:
        """The shapes of a machine whose description lies in `directory`.

        Raises:
            InputError: the machine has no arm, or its URDF is missing or unreadable.
        """
        path = urdf_path(machine, directory)
        self._model = compile_urdf(read_urdf(path), path)
        self._data = mujoco.MjData(self._model)
        joints = [self._model.joint(name) for name in machine.joint_names]
        self._addresses = np.array([int(joint.qposadr[0]) for joint in joints])
        parent, body_of = self._model.body_parentid, self._model.geom_bodyid
        self._pairs = np.array(
            [
                (first, second)
                for first, second in combinations(range(self._model.ngeom), 2)
                if body_of[first] != body_of[second]
                and parent[body_of[first]] != body_of[second]
                and parent[body_of[second]] != body_of[first]
            ]
        )
        radius = self._model.geom_rbound[self._pairs]
        self._reach = radius.sum(axis=1)

    def clearance(self, q: np.ndarray, horizon_m: float) -> float:
        """Least distance, m, in configuration `q` (n_joint,); `horizon_m` if all distances exceed it."""
        self._data.qpos[self._addresses] = q
        mujoco.mj_kinematics(self._model, self._data)
        first, second = self._pairs.T
        centre = self._data.geom_xpos
        # distance of bounding spheres: a lower bound that excludes most pairs
        gap = np.linalg.norm(centre[first] - centre[second], axis=1) - self._reach
        nearest = horizon_m
        for pair in np.argsort(gap):
            if gap[pair] >= nearest:
                break
            distance = mujoco.mj_geomDistance(self._model, self._data, *self._pairs[pair], nearest, None)
            nearest = min(nearest, distance)
        return nearest
