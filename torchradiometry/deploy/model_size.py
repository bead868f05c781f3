"""How large the graph of an ONNX file will be, before anything builds it.

A file is a tree of messages: `key value` again and again, key = 8 field + wire type, in base-128
numbers. A few bytes of it can ask for much: a graph of millions of nodes, functions that call
functions (each level multiplies), sparse tensors that are unpacked. So the parts that become
objects are counted, and what unpacks is refused; weights are stepped over.

References: *Protocol Buffers Encoding*; ONNX, `onnx.proto` (fields by number).
"""

from __future__ import annotations

__all__ = ["MAX_PARTS", "MAX_WEIGHTS", "graph_parts"]

#: nodes, names, attributes and tensors of a graph; the models here have some thousand
MAX_PARTS = 2**18
#: bytes of a model file: packed numbers grow eightfold when they are read
MAX_WEIGHTS = 2**28
#: message -> field -> the message it holds, of those that hold graphs
HOLDS = {
    "model": {7: "graph"},
    "graph": {1: "node"},
    "node": {5: "attribute"},
    "attribute": {6: "graph", 11: "graph"},
}
#: message -> field -> what it is called; none of our exports has them
REFUSED = {
    "model": {25: "functions of its own"},
    "graph": {15: "a sparse tensor"},
    "attribute": {22: "a sparse tensor", 23: "sparse tensors"},
}


def graph_parts(data: bytes, most: int = MAX_PARTS) -> int:
    """The number of parts of the graphs of a model; it stops above `most`.

    Raises:
        ValueError: no ONNX model, or one with functions or sparse tensors; a few words say which.

    >>> graph_parts(b"")
    0
    """
    parts, waiting = 0, [("model", 0, len(data))]
    while waiting:
        message, at, end = waiting.pop()
        while at < end and parts <= most:
            key, at = _number(data, at, end)
            field, wire = key >> 3, key & 7
            if field in REFUSED.get(message, {}):
                raise ValueError(REFUSED[message][field])
            start, at = _value(data, at, end, wire)
            parts += 1
            held = HOLDS[message].get(field)
            if held is not None and wire == 2:
                waiting.append((held, start, at))
    return parts


def _value(data: bytes, at: int, end: int, wire: int) -> tuple[int, int]:
    """Where the value of a field starts and ends."""
    if wire == 0:
        return at, _number(data, at, end)[1]
    if wire not in (1, 2, 5):
        raise ValueError("no ONNX model")
    length, start = _number(data, at, end) if wire == 2 else ({1: 8, 5: 4}[wire], at)
    if start + length > end:
        raise ValueError("cut short")
    return start, start + length


def _number(data: bytes, at: int, end: int) -> tuple[int, int]:
    """A base-128 number and where it ends."""
    value = 0
    for place in range(at, min(at + 10, end)):
        value |= (data[place] & 127) << 7 * (place - at)
        if data[place] < 128:
            return value, place + 1
    raise ValueError("cut short")
