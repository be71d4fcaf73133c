"""Writes an ONNX model as bytes; needs only NumPy.

An ONNX file is a message of Protocol Buffers (`onnx.proto` of the ONNX project). A message is a
sequence of fields. Each field has a key, which is its number and its kind, and a value. Two kinds
are enough here: a number of variable length, and bytes with their length.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from pyinfra.core.arrays import Float32Array, IntArray

OPSET, IR_VERSION = 18, 8
NUMBER, BYTES = 0, 2  # types of protobuf fields
FLOAT, INT64 = 1, 7  # element types of ONNX tensors
INTEGER, STRING, INTEGERS = 2, 3, 7  # types of ONNX attributes
Attribute = int | str | tuple[int, ...]
Dimension = int | str  # a size, or the name of a size that is only known when the model runs


@dataclass(frozen=True)
class Node:
    """An operation: its type, the names of its inputs and output, and its attributes."""

    operation: str
    inputs: tuple[str, ...]
    output: str
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Model:
    """A graph of operations with one input and one output.

    weights: the constant inputs, by name. input, output: name and shape.
    """

    nodes: Sequence[Node]
    weights: Mapping[str, Float32Array | IntArray]
    input: tuple[str, tuple[Dimension, ...]]
    output: tuple[str, tuple[Dimension, ...]]

    def __bytes__(self) -> bytes:
        return b"".join(_model(self))


def _model(model: Model) -> Iterator[bytes]:
    yield _number(1, IR_VERSION)
    yield _text(2, "pyinfra")
    yield _bytes(7, b"".join(_graph(model)))
    yield _bytes(8, _number(2, OPSET))


def _graph(model: Model) -> Iterator[bytes]:
    for node in model.nodes:
        yield _bytes(1, b"".join(_node(node)))
    yield _text(2, "detector")
    for name, array in model.weights.items():
        yield _bytes(5, b"".join(_constant(name, array)))
    for number, (name, shape) in ((11, model.input), (12, model.output)):
        yield _bytes(number, _text(1, name) + _bytes(2, _type(shape)))


def _node(node: Node) -> Iterator[bytes]:
    for name in node.inputs:
        yield _text(1, name)
    yield _text(2, node.output)
    yield _text(4, node.operation)
    for name, value in node.attributes.items():
        yield _bytes(5, _text(1, name) + _value(value))


def _value(value: Attribute) -> bytes:
    if isinstance(value, int):
        return _number(3, value) + _number(20, INTEGER)
    if isinstance(value, str):
        return _text(4, value) + _number(20, STRING)
    return b"".join(_number(8, number) for number in value) + _number(20, INTEGERS)


def _constant(name: str, array: Float32Array | IntArray) -> Iterator[bytes]:
    kind, dtype = (INT64, "<i8") if array.dtype.kind == "i" else (FLOAT, "<f4")
    for size in array.shape:
        yield _number(1, size)
    yield _number(2, kind)
    yield _text(8, name)
    yield _bytes(9, np.ascontiguousarray(array, dtype).tobytes())


def _type(shape: tuple[Dimension, ...]) -> bytes:
    sizes = [_number(1, size) if isinstance(size, int) else _text(2, size) for size in shape]
    content = b"".join(_bytes(1, size) for size in sizes)
    return _bytes(1, _number(1, FLOAT) + _bytes(2, content))


def _text(number: int, text: str) -> bytes:
    return _bytes(number, text.encode())


def _bytes(number: int, content: bytes) -> bytes:
    return _variable(number << 3 | BYTES) + _variable(len(content)) + content


def _number(number: int, value: int) -> bytes:
    return _variable(number << 3 | NUMBER) + _variable(value)


def _variable(value: int) -> bytes:
    """Returns a number of 0 or more as bytes with seven bits each, the lowest bits first."""
    digits = bytearray()
    while value >= 0x80:
        digits.append(value & 0x7F | 0x80)
        value >>= 7
    digits.append(value)
    return bytes(digits)
