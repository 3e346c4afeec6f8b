"""A policy as one C file without dependencies, for a programmable controller: from positions to commands."""

import textwrap
from collections.abc import Iterable
from importlib import resources
from typing import Any

import jinja2
import numpy as np

from pipeline.deployment.export.exported import ExportedPolicy
from pipeline.dynamics.model.specification import Target
from pipeline.machine.specification import CommandKind, JointKind
from pipeline.reaching.discretise import PROTO_ACTION_THRESHOLD

LINE_LENGTH = 120
SELF_TEST_TOLERANCE = 1e-4  # on proto-actions: rounding stays below it, a wrong constant or function does not
FLOAT, DOUBLE, INT = 4, 8, 4  # bytes


def policy_as_c(exported: ExportedPolicy) -> str:
    """The text of the file; the same policy gives the same text.

    What it computes equals `StateBuffers`, `VelocityEstimator` with one reading per row, and `PolicyController`, up to
    the rounding of float32. The estimator is in double precision here, too.
    """
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.globals["array"] = _array
    template = resources.files(__package__).joinpath("policy.c.j2").read_text(encoding="utf-8")
    return environment.from_string(template).render(**_content(exported)) + "\n"


def _content(exported: ExportedPolicy) -> dict[str, Any]:
    policy, task, machine = exported.policy, exported.task, exported.task.machine
    specification, n = task.dynamics.specification, exported.task.machine.n_joint
    n_rows, of_positions = specification.lags + 1, specification.target is Target.dq
    mean, std = np.asarray(policy.mean), np.asarray(policy.std)
    normalised = bool((mean != 0.0).any() or (std != 1.0).any())
    layers = [(np.asarray(layer.kernel), np.asarray(layer.bias)) for layer in policy.layers]
    kernel, bias = layers[-1]
    layers[-1] = kernel[:, :n], bias[:n]  # the others are the scale of exploration
    chain = [
        {
            "position": joint.position,
            "quaternion": joint.quaternion,
            "axis": joint.axis,
            "is_prismatic": int(joint.kind == JointKind.prismatic),
            "column": -1 if column is None else column,
        }
        for joint, column in zip(task.arm.joints, task.arm.columns, strict=True)
    ]
    n_widest = max(policy.observation_size, *(kernel.shape[1] for kernel, _ in layers))
    n_constants = sum(kernel.size + bias.size for kernel, bias in layers)
    n_constants += 2 * policy.observation_size * normalised + 12 * len(chain) + 3 * n + (n_rows + 3) * n
    return {
        "machine": machine.name,
        "origin": exported.origin,
        "discrete": machine.command_kind is CommandKind.discrete,
        "joints": [
            {"name": joint.name, "unit": joint.kind.unit, "lower": joint.lower, "upper": joint.upper}
            for joint in machine.joints
        ],
        "period_s": f"{specification.dt_s:g}",
        "dt_s": repr(specification.dt_s),
        "action_repeats": exported.action_repeats,
        "n_joint": n,
        "n_rows": n_rows,
        "of_positions": of_positions,
        "n_observation": policy.observation_size,
        "n_widest": n_widest,
        "proportional_gain": float(exported.loop_tracker.proportional_gain),
        "integral_gain": float(exported.loop_tracker.integral_gain),
        "lower": specification.position_lower,
        "upper": specification.position_upper,
        "velocity_limit": specification.velocity_limit,
        "chain": chain,
        "normalised": normalised,
        "mean": mean,
        "std": std,
        "layers": [
            {"kernel": kernel, "bias": bias, "n_in": kernel.shape[0], "n_out": kernel.shape[1]}
            for kernel, bias in layers
        ],
        "threshold": _number(PROTO_ACTION_THRESHOLD),
        "run": exported.reference_run(),
        "tolerance": _number(SELF_TEST_TOLERANCE),
        "constant_bytes": FLOAT * n_constants,
        "state_bytes": 2 * n * DOUBLE + (2 * n + 2 * n_rows * n) * FLOAT + 2 * INT,
        "stack_bytes": FLOAT * 2 * n_widest,
    }


def _array(values: Iterable[float]) -> str:
    """A C initialiser, in lines; every number is written so that it is read as the same float32."""
    text = "{" + ", ".join(_number(value) for value in np.ravel(np.asarray(values))) + "}"
    return (
        text if len(text) < LINE_LENGTH // 2 else textwrap.fill(text, LINE_LENGTH, subsequent_indent="    ")
    )


def _number(value: float) -> str:
    return f"{np.float32(value)!s}f"
