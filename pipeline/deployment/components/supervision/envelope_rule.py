"""The rule of the envelope: the region in which experiments are planned."""

from dataclasses import replace

import jax
import numpy as np

from pipeline.deployment.components.supervision.rule import Rule
from pipeline.deployment.messages import JointState
from pipeline.deployment.settings import EnvelopeConfig
from pipeline.errors import InputError
from pipeline.machine.kinematics import Arm
from pipeline.machine.poses import workspace_of
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import contains


class Envelope:
    """W+, widened as the operator says, and bounds of joints beside it."""

    def __init__(self, machine: MachineSpecification, arm: Arm, config: EnvelopeConfig) -> None:
        """The region of a machine.

        Raises:
            InputError: the machine has no W+, or a bound names another joint.
        """
        workspace, wider_m = workspace_of(machine), config.wider_m
        region = replace(
            workspace,
            radius_min_m=max(workspace.radius_min_m - wider_m, 0.0),
            radius_max_m=workspace.radius_max_m + wider_m,
            yaw_max_rad=workspace.yaw_max_rad + config.wider_rad,
            z_min_m=workspace.z_min_m - wider_m,
            z_max_m=workspace.z_max_m + wider_m,
        )
        self.lower = np.full(machine.n_joint, -np.inf)
        self.upper = np.full(machine.n_joint, np.inf)
        for name, bounds in config.joints.items():
            if name not in machine.joint_names:
                known = ", ".join(machine.joint_names)
                raise InputError(
                    f"deployment.supervisor.envelope.joints: no joint `{name}`; known are {known}"
                )
            joint = machine.joint_names.index(name)
            self.lower[joint], self.upper[joint] = bounds
        self._contains = jax.jit(lambda q: contains(region, arm.forward(q).position, arm.yaw(q)))
        self.holds(machine.lower)  # compiled before the first state comes

    def holds(self, q: np.ndarray) -> bool:
        """Whether a configuration (n_joint,), rad (m), lies in the region."""
        return bool(
            (q >= self.lower).all() and (q <= self.upper).all() and self._contains(q.astype(np.float32))
        )


class StaysInEnvelope(Rule):
    """The arm does not leave the envelope. One that begins outside may come in first."""

    def __init__(self, envelope: Envelope) -> None:
        self._envelope = envelope
        self._state: JointState | None = None
        self._was_inside = False

    def on_state(self, state: JointState, now_ns: int) -> str | None:
        """Look at a joint state."""
        self._state = state
        return None

    def on_tick(self, now_ns: int) -> str | None:
        """Check the newest state: they arrive more often than necessary."""
        state, self._state = self._state, None
        if state is None or not np.isfinite(state.position).all():
            return None
        is_inside = self._envelope.holds(state.position)
        if self._was_inside and not is_inside:
            return f"the arm leaves the envelope at {np.round(state.position, 3).tolist()}"
        self._was_inside |= is_inside
        return None
