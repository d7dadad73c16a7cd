"""SEs as ONNX models, for any runtime.

inputs   state (n, S) float32, action (n,) int64
outputs  next_state (n, S), reward (n,), done (n,); an episode ends at done > 0.5
"""

import json
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from bilevel.networks import Network, layer_biases, layer_weights
from bilevel.synthetic_env import NETWORKS, Psi, StoredSE

#: The oldest set of operators that has all that an SE needs, so that old runtimes read it too.
_OPERATORS = 13
_FORMAT = 8  # of the file


def onnx_model(se: StoredSE) -> onnx.ModelProto:
    """The SE as an ONNX model, whose metadata tell task, architecture and origin as the header of
    an SE file does."""
    architecture = se.architecture
    parts = architecture.split(se.psi)
    constants: dict[str, NDArray[Any]] = {
        "depth": np.array(architecture.n_actions, np.int64),
        "off_on": np.array([0, 1], np.float32),
        "last": np.array([1], np.int64),
    }
    nodes = [
        helper.make_node("OneHot", ["action", "depth", "off_on"], ["one_hot"]),
        helper.make_node("Concat", ["one_hot", "state"], ["inputs"], axis=1),
    ]
    for name, net, part in zip(NETWORKS, architecture.networks, parts, strict=True):
        constants |= dict(_parameters(name, net, part))
        nodes += _layers(name, net, architecture.activation, architecture.slope)
    nodes += [
        helper.make_node("Identity", ["next_state.out"], ["next_state"]),
        helper.make_node("Squeeze", ["reward.out", "last"], ["reward"]),
        helper.make_node("Squeeze", ["done.out", "last"], ["done"]),
    ]
    states: list[int | str] = ["n", architecture.state_size]
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
    facts = {
        "task": se.task_id,
        "step_limit": se.step_limit,
        "solved_reward": se.solved_reward,
        "architecture": asdict(architecture),
        "info": dict(se.info),
    }
    helper.set_model_props(model, {"se": json.dumps(facts)})
    onnx.checker.check_model(model, full_check=True)
    return model


def _value(name: str, shape: list[int | str], kind: int = TensorProto.FLOAT) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(name, kind, shape)


def _parameters(name: str, net: Network, part: Psi) -> Iterator[tuple[str, Psi]]:
    for layer in range(net.sizes.size - 1):
        yield f"{name}.{layer}.weight", np.ascontiguousarray(layer_weights(net, part, layer))
        yield f"{name}.{layer}.bias", np.ascontiguousarray(layer_biases(net, part, layer))


def _layers(name: str, net: Network, activation: str, slope: float) -> Iterator[onnx.NodeProto]:
    """The nodes of one network, from `inputs` to `NAME.out`."""
    last, read = net.sizes.size - 2, "inputs"
    for layer in range(last + 1):
        linear = f"{name}.out" if layer == last else f"{name}.{layer}.linear"
        weights = [f"{name}.{layer}.weight", f"{name}.{layer}.bias"]
        yield helper.make_node("Gemm", [read, *weights], [linear], transB=1)
        if layer == last:
            return
        read = f"{name}.{layer}.active"
        if activation == "tanh":
            yield helper.make_node("Tanh", [linear], [read])
        else:  # a ReLU is a LeakyReLU of slope 0
            yield helper.make_node("LeakyRelu", [linear], [read], alpha=slope)
