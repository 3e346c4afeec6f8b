"""Which simulators there are, and all kinds of cases that they draw."""

from benchmarks.closed_loop import kinds
from benchmarks.closed_loop.hydraulic_plant import HydraulicPlant
from benchmarks.closed_loop.kinematic_joints import KinematicJoints
from benchmarks.closed_loop.mujoco_joints import MujocoJoints
from benchmarks.closed_loop.simulator import Simulator

PLANT, KINEMATIC, MUJOCO = HydraulicPlant(), KinematicJoints(), MujocoJoints()

SIMULATORS: dict[str, Simulator] = {simulator.name: simulator for simulator in (PLANT, KINEMATIC, MUJOCO)}
"""By name."""

OUTSIDE = tuple(dict.fromkeys(kind for simulator in SIMULATORS.values() for kind in simulator.outside))
"""Kinds that no family of the contract describes."""

KINDS = kinds.in_order(OUTSIDE)
"""Every kind of case of any simulator, in the order of tables."""
