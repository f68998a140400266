#!/usr/bin/env python3
"""Writes bev.onnx and pillars.onnx: networks of a few nodes with weights that make their answers
computable by hand (see onnx_detector_test.cpp). They are encoded without the onnx package, after onnx.proto
(https://github.com/onnx/onnx/blob/main/onnx/onnx.proto; numbers of fields stand at their use), operator set 11.

usage: make_networks.py FOLDER
"""

import math
import pathlib
import struct
import sys

FLOAT, INT32, INT64 = 1, 6, 7  # TensorProto.DataType


def varint(value):
    value &= (1 << 64) - 1
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    out.append(value)
    return bytes(out)


def field(number, value):
    """One field: whole numbers as varint, text and bytes with their length."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def fields(number, values):
    return b"".join(field(number, value) for value in values)


def tensor(name, data_type, shape, values):
    """TensorProto: dims 1, data_type 2, name 8, raw_data 9."""
    raw = struct.pack(f"<{len(values)}{'f' if data_type == FLOAT else 'q'}", *values)
    return fields(1, shape) + field(2, data_type) + field(8, name) + field(9, raw)


def attribute(name, value):
    """AttributeProto: name 1, i 3, ints 8, type 20 (INT 2, INTS 7)."""
    if isinstance(value, int):
        return field(1, name) + field(3, value) + field(20, 2)
    return field(1, name) + fields(8, value) + field(20, 7)


def node(operator, inputs, output, **attributes):
    """NodeProto: input 1, output 2, op_type 4, attribute 5."""
    texts = [attribute(name, value) for name, value in attributes.items()]
    return fields(1, inputs) + field(2, output) + field(4, operator) + fields(5, texts)


def value_info(name, data_type, shape):
    """ValueInfoProto: name 1, type 2 > tensor_type 1: elem_type 1, shape 2 > dim 1: dim_value 1 or dim_param 2."""
    dims = [field(2, size) if isinstance(size, str) else field(1, size) for size in shape]
    return field(1, name) + field(2, field(1, field(1, data_type) + field(2, fields(1, dims))))


def model(name, nodes, weights, inputs, outputs):
    """ModelProto: ir_version 1, graph 7, opset_import 8 > version 2. GraphProto: node 1, name 2, initializer 5,
    input 11, output 12."""
    graph = fields(1, nodes) + field(2, name) + fields(5, weights)
    graph += fields(11, [value_info(*v) for v in inputs]) + fields(12, [value_info(*v) for v in outputs])
    return field(1, 6) + field(7, graph) + field(8, field(2, 11))


def convolution(name, picture, kernel, weights, biases):
    """A kernel x kernel convolution with stride kernel that sums channels: one row of weights for each output.
    @return its node and its two tensors."""
    flat = [w for row in weights for w in row for _ in range(kernel * kernel)]
    shape = [len(weights), len(weights[0]), kernel, kernel]
    return node("Conv", [picture, f"{name}_w", f"{name}_b"], name, strides=[kernel, kernel]), [
        tensor(f"{name}_w", FLOAT, shape, flat), tensor(f"{name}_b", FLOAT, [len(biases)], biases)]


def heads(picture, kernel, branches):
    nodes, weights = [], []
    for name, rows, biases in branches:
        made, tensors = convolution(name, picture, kernel, rows, biases)
        nodes.append(made)
        weights += tensors
    nodes.append(node("Sigmoid", ["logits"], "scores"))
    return nodes, weights


def bev():
    """[1, 2, 8, 8] of max_z and log_count, stride 2. Sums run over the four cells."""
    nodes, weights = heads("bev", 2, [
        ("logits", [[4, 0], [0, 4]], [-6, -5]),
        ("offset", [[0, 0], [0, 0]], [0.25, 0.75]),
        ("height", [[0.5, 0]], [0]),
        ("size", [[0, 0]] * 3, [math.log(4), math.log(2), math.log(1.5)]),
        ("rotation", [[0, 0], [0, 0]], [0.6, 0.8]),
    ])
    nodes.append(node("Identity", ["size"], "open"))
    outputs = [(name, FLOAT, [1, channels, 4, 4]) for name, channels in
               [("logits", 2), ("scores", 2), ("offset", 2), ("height", 1), ("size", 3), ("rotation", 2)]]
    outputs.append(("open", FLOAT, [1, "channels", "rows", "columns"]))
    return model("bev", nodes, weights, [("bev", FLOAT, [1, 2, 8, 8])], outputs)


def pillars():
    """Largest z, mean_dz, centre_dx of a pillar's 4 points and their count, scattered onto 4 x 6 cells, stride 1."""
    nodes = [
        node("ReduceMax", ["points"], "largest", axes=[1], keepdims=0),
        node("Cast", ["counts"], "counts_float", to=FLOAT),
        node("Unsqueeze", ["counts_float"], "counts_column", axes=[1]),
        node("Concat", ["largest", "counts_column"], "features", axis=1),
        node("Cast", ["cells"], "cells_wide", to=INT64),
        node("Slice", ["cells_wide", "two", "four", "one"], "places"),
        node("ScatterND", ["empty", "places", "features"], "scattered"),
        node("Transpose", ["scattered"], "channels_first", perm=[2, 0, 1]),
        node("Unsqueeze", ["channels_first"], "picture", axes=[0]),
    ]
    weights = [tensor(name, INT64, [1], [value]) for name, value in [("one", 1), ("two", 2), ("four", 4)]]
    weights.append(tensor("empty", FLOAT, [4, 6, 4], [0.0] * 96))
    head_nodes, head_weights = heads("picture", 1, [
        ("logits", [[4, 0, 0, 0]], [-6]),
        ("offset", [[0, 0, 1, 0], [0, 1, 0, 0]], [0.5, 0.5]),
        ("height", [[0.5, 0, 0, 0]], [0]),
        ("size", [[0, 0, 0, 1], [0] * 4, [0] * 4], [0, 2, 1.5]),
        ("rotation", [[0] * 4, [0] * 4], [0.6, 0.8]),
    ])
    inputs = [("points", FLOAT, ["pillars", 4, 3]), ("cells", INT32, ["pillars", 4]), ("counts", INT64, ["pillars"])]
    outputs = [(name, FLOAT, [1, channels, 4, 6]) for name, channels in
               [("scores", 1), ("offset", 2), ("height", 1), ("size", 3), ("rotation", 2)]]
    return model("pillars", nodes + head_nodes, weights + head_weights, inputs, outputs)


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bev.onnx").write_bytes(bev())
    (folder / "pillars.onnx").write_bytes(pillars())


if __name__ == "__main__":
    main()
