"""SEs as ONNX models.

inputs   state (n, S) float32, action (n,) int64
outputs  next_state (n, S), reward (n,), done (n,); an episode ends at done > 0.5
"""

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, TensorProto, helper, numpy_helper

from bilevel.networks import layer_biases, layer_weights
from bilevel.synthetic_env import NETWORKS, StoredSE

#: The oldest operator set and file format that suffice, for old runtimes.
_OPERATORS, _FORMAT = 13, 8


def onnx_model(se: StoredSE) -> onnx.ModelProto:
    """Export an SE as an ONNX model. Its metadata `se` is a JSON mapping with task, architecture
    and info, as in the header of an SE file."""
    nodes, constants = _graph(se)
    states: list[int | str] = ["n", se.architecture.state_size]
    graph = helper.make_graph(
        nodes,
        "synthetic_environment",
        [_value("state", states), _value("action", ["n"], TensorProto.INT64)],
        [_value("next_state", states), _value("reward", ["n"]), _value("done", ["n"])],
        [numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    model = helper.make_model(
        graph, opset_imports=[helper.make_opsetid("", _OPERATORS)], ir_version=_FORMAT
    )
    metadata = {
        "task": se.task_id,
        "step_limit": se.step_limit,
        "solved_reward": se.solved_reward,
        "architecture": asdict(se.architecture),
        "info": dict(se.info),
    }
    helper.set_model_props(model, {"se": json.dumps(metadata)})
    onnx.checker.check_model(model, full_check=True)
    return model


def _value(name: str, shape: list[int | str], kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def _graph(se: StoredSE) -> tuple[list[NodeProto], dict[str, NDArray[Any]]]:
    """Return the nodes and the constants by name."""
    architecture = se.architecture
    constants: dict[str, NDArray[Any]] = {
        "depth": np.array(architecture.n_actions, np.int64),
        "off_on": np.array([0, 1], np.float32),
        "last": np.array([1], np.int64),
    }
    nodes = [
        helper.make_node("OneHot", ["action", "depth", "off_on"], ["one_hot"]),
        helper.make_node("Concat", ["one_hot", "state"], ["inputs"], axis=1),
    ]
    parts = architecture.split(se.psi)
    for name, net, part in zip(NETWORKS, architecture.networks, parts, strict=True):
        value = "inputs"
        for layer in range(len(net.shapes)):
            weight, bias = f"{name}.{layer}.weight", f"{name}.{layer}.bias"
            constants[weight] = np.ascontiguousarray(layer_weights(net, part, layer))
            constants[bias] = np.ascontiguousarray(layer_biases(net, part, layer))
            if layer:
                nodes.append(_activation(se, value, f"{value}.active"))
                value = f"{value}.active"
            linear = f"{name}.{layer}.linear"
            nodes.append(helper.make_node("Gemm", [value, weight, bias], [linear], transB=1))
            value = linear
        squeezed = name != "next_state"
        inputs = [value, "last"] if squeezed else [value]
        nodes.append(helper.make_node("Squeeze" if squeezed else "Identity", inputs, [name]))
    return nodes, constants


def _activation(se: StoredSE, value: str, output: str) -> NodeProto:
    if se.architecture.activation == "tanh":
        return helper.make_node("Tanh", [value], [output])
    # A ReLU is a LeakyReLU with slope 0.
    return helper.make_node("LeakyRelu", [value], [output], alpha=se.architecture.slope)
