"""SEs as ONNX models and `torch.export` programs, which need no part of this package.

inputs   state (n, S) float32; action (n,) int64, or (n, A) float32 in [-1, 1] if continuous
outputs  next_state (n, S), reward (n,), done (n,); an episode ends at done > 0.5
"""

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch.export import Dim, ExportedProgram, export

from bilevel.synthetic_env import NETWORKS, StoredSE
from bilevel.synthetic_env.storage import header_of
from bilevel.synthetic_env.torch_module import SEModule

if TYPE_CHECKING:
    import onnx

#: The oldest operator set and file format that suffice, for old runtimes.
_OPERATORS, _FORMAT = 13, 8


def torch_program(se: StoredSE) -> ExportedProgram:
    """Export an SE for batches of at least 2 states and actions."""
    rows = {0: Dim("n", min=2)}
    arch = se.architecture
    actions = torch.zeros(2, arch.action_size) if arch.continuous else torch.zeros(2).long()
    example = (torch.zeros(2, arch.state_size), actions)
    return export(SEModule(se), example, dynamic_shapes={"state": rows, "action": rows})


def onnx_model(se: StoredSE) -> "onnx.ModelProto":
    """Export an SE as an ONNX model, with the header of the SE's file as its metadata `se`."""
    import onnx
    from onnx import TensorProto, helper, numpy_helper

    arch, info = se.architecture, helper.make_tensor_value_info
    states: list[str | int | None] = ["n", arch.state_size]
    actions: list[str | int | None] = ["n", arch.action_size] if arch.continuous else ["n"]
    of_actions = TensorProto.FLOAT if arch.continuous else TensorProto.INT64
    values = [
        info("state", TensorProto.FLOAT, states),
        info("action", of_actions, actions),
        info("next_state", TensorProto.FLOAT, states),
        info("reward", TensorProto.FLOAT, ["n"]),
        info("done", TensorProto.FLOAT, ["n"]),
    ]
    nodes, constants = _graph(se)
    tensors = [numpy_helper.from_array(value, name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "synthetic_environment", values[:2], values[2:], tensors)
    operators = [helper.make_opsetid("", _OPERATORS)]
    model = helper.make_model(graph, opset_imports=operators, ir_version=_FORMAT)
    helper.set_model_props(model, {"se": json.dumps(header_of(se))})
    onnx.checker.check_model(model, full_check=True)
    return model


def _graph(se: StoredSE) -> tuple[list["onnx.NodeProto"], dict[str, NDArray[Any]]]:
    """Return the nodes and the constants by name."""
    from onnx import helper

    arch = se.architecture
    constants: dict[str, NDArray[Any]] = {
        name: tensor.copy() for name, tensor in arch.tensors(se.psi).items()
    }
    constants |= {
        "depth": np.array(arch.action_size),
        "off_on": np.array([0, 1], np.float32),
        "last": np.array([1]),
    }
    encoded = "action" if arch.continuous else "one_hot"
    nodes = [helper.make_node("Concat", [encoded, "state"], ["inputs"], axis=1)]
    if not arch.continuous:
        nodes.insert(0, helper.make_node("OneHot", ["action", "depth", "off_on"], ["one_hot"]))
    # A ReLU is a LeakyReLU with slope 0.
    tanh = arch.activation == "tanh"
    slope: dict[str, Any] = {} if tanh else {"alpha": arch.slope}
    for name in NETWORKS:
        value = "inputs"
        for layer in range(arch.hidden_layers + 1):
            if layer:
                given, value = value, f"{value}.active"
                kind = "Tanh" if tanh else "LeakyRelu"
                nodes.append(helper.make_node(kind, [given], [value], **slope))
            inputs = [value, f"{name}.{layer}.weight", f"{name}.{layer}.bias"]
            value = f"{name}.{layer}.linear"
            nodes.append(helper.make_node("Gemm", inputs, [value], transB=1))
        squeezed = name != "next_state"
        inputs = [value, "last"] if squeezed else [value]
        nodes.append(helper.make_node("Squeeze" if squeezed else "Identity", inputs, [name]))
    return nodes, constants
