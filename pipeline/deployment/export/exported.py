"""What an exported policy is made of, and a run of it that a copy must repeat."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

from pipeline.control.policy import POLICY_FILE, Policy, load_policy_of
from pipeline.deployment.components.controllers import ControllerState, measured
from pipeline.deployment.components.state_buffers import StateBuffers
from pipeline.dynamics.model.specification import Target
from pipeline.effects.store import dynamics_fingerprint, load_dynamics
from pipeline.errors import InputError
from pipeline.logs.loop_tracker import LoopTrackerConfig, advance, initial_state
from pipeline.reaching.settings import ReachingSettings
from pipeline.reaching.task import ReachingTask

RUN_BEGIN, RUN_TRAVEL = 0.4, 0.2  # of the joint range: the arm moves in its middle


class ReferenceRun(NamedTuple):
    """A motion and the decision after it.

    Attributes:
        q: positions, (n_ticks, n_joint), float32, rad (m).
        commands: in force before each of them, (n_ticks, n_joint), float32.
        target: configuration, (n_joint,), float32.
        proto_action: (n_joint,), float32.
    """

    q: np.ndarray
    commands: np.ndarray
    target: np.ndarray
    proto_action: np.ndarray


@dataclass(frozen=True)
class ExportedPolicy:
    """A policy with all that stands between the machine's positions and its observations.

    Attributes:
        task: machine, kinematics and the window of the model that the policy was learned on.
        loop_tracker: of the velocities.
        action_repeats: ticks per decision.
        origin: lines that say where the policy is from.
    """

    policy: Policy
    task: ReachingTask
    loop_tracker: LoopTrackerConfig
    action_repeats: int
    origin: tuple[str, ...]

    def __post_init__(self) -> None:
        if not self.policy.is_finite:
            raise InputError("the policy's weights are not all finite; train it again")

    def reference_run(self) -> ReferenceRun:
        """A slow motion through the middle of the joint range, under commands that change at every tick."""
        task, specification = self.task, self.task.dynamics.specification
        machine, n_ticks = task.machine, specification.lags + 2
        tick, joint = np.arange(n_ticks)[:, None], np.arange(machine.n_joint)
        share = RUN_BEGIN + RUN_TRAVEL * tick / n_ticks
        q = (machine.lower + share * (machine.upper - machine.lower)).astype(np.float32)
        commands = ((tick + joint) % 3 - 1).astype(np.float32)
        target = (0.5 * (np.asarray(machine.lower) + machine.upper)).astype(np.float32)

        buffers, tracker = StateBuffers(specification), initial_state(q[0])
        for number, (position, command) in enumerate(zip(q, commands, strict=True)):
            if number:
                tracker, _ = advance(tracker, position, specification.dt_s, self.loop_tracker)
            buffers.push(position, tracker.integral, command)
        state = ControllerState(buffers.motion, buffers.commands, q[-1], target)
        act = jax.jit(lambda policy, state: policy.act(task.observe(measured(task, state))))
        return ReferenceRun(q, commands, target, np.asarray(act(self.policy, state)))

    def observation_layout(self) -> list[tuple[str, tuple[int, ...]]]:
        """Parts of an observation in their order: what they are, and their shape."""
        specification = self.task.dynamics.specification
        n = specification.n_joint
        rows = (specification.lags + 1, n)
        motion = "velocities" if specification.target is Target.dqdot else "positions"
        return [
            (f"{motion}, normalised, oldest first", rows),
            ("commands, oldest first", rows),
            ("position, normalised", (n,)),
            ("tip's position, m", (3,)),
            ("tip's quaternion (w, x, y, z)", (4,)),
            ("target's tip position, m", (3,)),
            ("target's tip quaternion", (4,)),
            ("position, normalised", (n,)),
            ("target's position, normalised", (n,)),
        ]


def exported_policy(
    model: Path, policy: Path, reaching: ReachingSettings, loop_tracker: LoopTrackerConfig
) -> ExportedPolicy:
    """Read a policy, and the model that it was learned on, from their folders.

    Raises:
        InputError: see `load_dynamics` and `load_policy_of`; or weights are not finite.
    """
    task, weights = reaching.task(*load_dynamics(model)), load_policy_of(policy, model, reaching.machine.name)
    digest = hashlib.sha256((policy / POLICY_FILE).read_bytes()).hexdigest()
    origin = (f"Policy, sha256 {digest}.", f"Model, sha256 {dynamics_fingerprint(model)}.")
    return ExportedPolicy(weights, task, loop_tracker, reaching.action_repeats, origin)
