"""A policy as an ONNX graph, for other runtimes. Needs the extra `onnx`.

inputs    (N, 18)   float
tilt      (N, 2)    float, output: rad, outwards and along the ring, not limited
distance  (N,)      float, output: distance from the training data, see `Policy.distance`
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mazeplan.control.policy import INPUTS, KNOWN, Policy
from mazeplan.core.errors import InputError
from mazeplan.core.resources import to_install
from mazeplan.core.whole_file import whole_file

OPSET, IR_VERSION = 17, 8  # what runtimes since 2022 read


def save_onnx(policy: Policy, path: Path) -> None:
    """Write the graph. Raises InputError if onnx is missing or the file cannot be written."""
    try:
        import onnx  # noqa: F401  only to see whether it loads
    except ImportError as problem:
        raise InputError(f"a policy as ONNX needs onnx: {to_install('onnx')} ({problem})") from None
    text = onnx_model(policy).SerializeToString()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as beside:
            beside.write_bytes(text)
    except OSError as problem:
        raise InputError(f"cannot be written: {problem.strerror or problem}", file=path) from None


def onnx_model(policy: Policy) -> Any:
    """The checked `onnx.ModelProto`; its metadata name the inputs."""
    from onnx import TensorProto, checker, helper

    graph = _Graph()
    z = graph.node("Div", graph.node("Sub", "inputs", graph.constant(policy.mean)), graph.constant(policy.scale))
    h = z
    for k, (weights, bias) in enumerate(policy.layers):
        h = graph.node("Gemm", h, graph.constant(weights), graph.constant(bias), transB=1)
        h = graph.node("Tanh", h) if k < len(policy.layers) - 1 else h
    graph.node("Mul", h, graph.constant(np.float32(policy.limit)), name="tilt")
    known = graph.node("Slice", z, graph.constant([0]), graph.constant([KNOWN]), graph.constant([1]))
    gap = graph.node("Sub", graph.constant(policy.centres), graph.node("Unsqueeze", known, graph.constant([1])))
    squares = graph.node("ReduceSum", graph.node("Mul", gap, gap), graph.constant([2]), keepdims=0)
    least = graph.node("ReduceMin", squares, axes=[1], keepdims=0)
    graph.node("Div", graph.node("Sqrt", least), graph.constant(np.float32(policy.reach)), name="distance")

    shapes = {"inputs": ["N", len(INPUTS)], "tilt": ["N", 2], "distance": ["N"]}
    values = {name: helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in shapes.items()}
    made = helper.make_graph(
        graph.nodes, "policy", [values["inputs"]], [values["tilt"], values["distance"]], graph.constants
    )
    opset = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(made, producer_name="mazeplan", opset_imports=opset, ir_version=IR_VERSION)
    helper.set_model_props(model, {"inputs": " ".join(INPUTS), "doc": "tilt in rad, out and along, not limited"})
    checker.check_model(model, full_check=True)
    return model


class _Graph:
    """Nodes and constants of a graph, each with a unique name."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def node(self, kind: str, *inputs: str, name: str | None = None, **attributes: Any) -> str:
        """Add a node. Returns the name of its output."""
        from onnx import helper

        output = name or f"{kind.lower()}{len(self.nodes)}"
        self.nodes.append(helper.make_node(kind, inputs, [output], **attributes))
        return output

    def constant(self, values: Any) -> str:
        """Add an array of numbers, as float32 or int64. Returns its name."""
        from onnx import numpy_helper

        array = np.asarray(values)
        kind = np.int64 if array.dtype.kind == "i" else np.float32
        name = f"constant{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(array, dtype=kind), name))
        return name
