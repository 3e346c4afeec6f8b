"""A policy as ONNX: from observations to commands, with the normalisation of observations inside."""

import json
from typing import Any

import numpy as np

from pipeline.deployment.export.exported import ExportedPolicy
from pipeline.errors import InputError
from pipeline.machine.specification import CommandKind
from pipeline.reaching.discretise import PROTO_ACTION_THRESHOLD

OPSET, IR_VERSION = 13, 8  # of 2021: old runtimes read them, and no newer operator is needed
OBSERVATION, PROTO_ACTION, COMMAND = "observation", "proto_action", "command"


def policy_as_onnx(exported: ExportedPolicy) -> bytes:
    """The content of the file; the same policy gives the same bytes.

    Input: `observation` (n, n_observation), float32, as `ReachingTask.observe` gives it. Outputs: `proto_action` and
    `command`, both (n, n_joint), float32. The metadata says what an observation is made of.

    Raises:
        InputError: the package onnx is missing.
    """
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError:
        raise InputError("the package onnx is missing; `make env` installs it") from None

    policy, machine = exported.policy, exported.task.machine
    nodes: list[Any] = []
    constants: list[Any] = []

    def constant(values: Any) -> str:
        name = f"constant_{len(constants)}"
        constants.append(numpy_helper.from_array(np.asarray(values, np.float32), name))
        return name

    def apply(operator: str, *inputs: str, output: str | None = None, **attributes: Any) -> str:
        name = output or f"value_{len(nodes)}"
        nodes.append(helper.make_node(operator, inputs, [name], **attributes))
        return name

    x = apply("Div", apply("Sub", OBSERVATION, constant(policy.mean)), constant(policy.std))
    for number, layer in enumerate(policy.layers):
        is_last = number == len(policy.layers) - 1
        wanted = slice(machine.n_joint) if is_last else slice(None)  # the others are the scale of exploration
        x = apply("MatMul", x, constant(np.asarray(layer.kernel)[:, wanted]))
        x = apply("Add", x, constant(np.asarray(layer.bias)[wanted]))
        x = apply("Tanh", x, output=PROTO_ACTION) if is_last else apply("Mul", x, apply("Sigmoid", x))
    if machine.command_kind is CommandKind.discrete:
        acts = apply("Greater", apply("Abs", x), constant(PROTO_ACTION_THRESHOLD))
        apply("Mul", apply("Sign", x), apply("Cast", acts, to=TensorProto.FLOAT), output=COMMAND)
    else:
        apply("Clip", x, constant(-1.0), constant(1.0), output=COMMAND)

    def tensor(name: str, width: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", width])

    graph = helper.make_graph(
        nodes,
        f"reaching policy of {machine.name}",
        [tensor(OBSERVATION, policy.observation_size)],
        [tensor(PROTO_ACTION, machine.n_joint), tensor(COMMAND, machine.n_joint)],
        constants,
    )
    model = helper.make_model(
        graph,
        producer_name="hydraulic-arm-pipeline",
        ir_version=IR_VERSION,
        opset_imports=[helper.make_opsetid("", OPSET)],
    )
    helper.set_model_props(model, _metadata(exported))
    checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)


def _metadata(exported: ExportedPolicy) -> dict[str, str]:
    specification, machine = exported.task.dynamics.specification, exported.task.machine
    content = {
        "machine": machine.name,
        "origin": exported.origin,
        "joints": [f"{joint.name}, {joint.kind.unit}" for joint in machine.joints],
        "rate_hz": specification.rate_hz,
        "ticks_per_decision": exported.action_repeats,
        "loop_tracker": vars(exported.loop_tracker),
        "position_lower": specification.position_lower,
        "position_upper": specification.position_upper,
        "velocity_limit": specification.velocity_limit,
        "observation": exported.observation_layout(),
    }
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in content.items()}
