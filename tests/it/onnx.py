"""Checks exported ONNX files against predictions: python3 onnx.py MODEL.onnx PREDICTED.h5

Prints the largest difference in mm from the file of `deaflow predict`: by the evaluator below, which reads the protocol buffer
itself and needs numpy alone, and by onnxruntime where that can be imported. Exit code 1 where one is above 1e-5 mm.
"""

import struct
import sys

import h5py
import numpy as np

TOLERANCE = 1e-5
TYPES = {1: np.float32, 2: np.uint8, 7: np.int64}


def fields(data):
    """The fields of a message: (number, value); numbers as integers or four bytes, all else as bytes."""
    at = 0

    def varint():
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                return value - (1 << 64) if value >> 63 else value

    while at < len(data):
        key = varint()
        if key & 7 == 0:
            value = varint()
        else:
            size = {2: varint, 5: lambda: 4}[key & 7]()
            assert at + size <= len(data), "cut short"
            value = data[at : at + size]
            at += size
        yield key >> 3, value


def collected(data):
    found = {}
    for number, value in fields(data):
        found.setdefault(number, []).append(value)
    return found


def attribute(data):
    a = collected(data)
    kind = a[20][0]
    value = {1: lambda: struct.unpack("<f", a[2][0])[0], 2: lambda: a[3][0], 7: lambda: a.get(8, [])}[kind]()
    return a[1][0].decode(), value


def tensor(data):
    t = collected(data)
    return t[8][0].decode(), np.frombuffer(t[9][0], TYPES[t[2][0]]).reshape(t.get(1, []))


def declared(data):
    """Name, element type and shape of an input or output."""
    v = collected(data)
    kind = collected(collected(v[2][0])[1][0])
    dims = [collected(d) for d in collected(kind[2][0]).get(1, [])]
    return v[1][0].decode(), kind[1][0], [d[1][0] if 1 in d else d[2][0].decode() for d in dims]


def conv(x, w, pads, strides=(1, 1)):
    x = np.pad(x, ((0, 0), (0, 0), (pads[0], pads[2]), (pads[1], pads[3])))
    windows = np.lib.stride_tricks.sliding_window_view(x, w.shape[2:], (2, 3))[:, :, :: strides[0], :: strides[1]]
    return np.einsum("nchwij,ocij->nohw", windows, w, optimize=True)


def conv_transpose(x, w, pads, strides=(1, 1)):
    n, _, h, v = x.shape
    (_, o, k, l), (s, t) = w.shape, strides
    y = np.zeros((n, o, (h - 1) * s + k, (v - 1) * t + l), np.float32)
    for i in range(k):
        for j in range(l):
            y[:, :, i : i + (h - 1) * s + 1 : s, j : j + (v - 1) * t + 1 : t] += np.einsum(
                "nchw,co->nohw", x, w[:, :, i, j], optimize=True
            )
    return y[:, :, pads[0] : y.shape[2] - pads[2], pads[1] : y.shape[3] - pads[3]]


def reshape(x, shape):
    return x.reshape([x.shape[i] if d == 0 else d for i, d in enumerate(shape)])


def slices(x, starts, ends, axes=None, steps=None):
    axes = range(x.ndim) if axes is None else axes
    steps = [1] * len(starts) if steps is None else steps
    at = [slice(None)] * x.ndim
    for a, start, end, step in zip(axes, starts, ends, steps):
        at[a] = slice(start, end, step)
    return x[tuple(at)]


def pad(x, zeros, value=None):
    assert value is None or value == 0
    return np.pad(x, list(zip(zeros[: x.ndim], zeros[x.ndim :])))


OPERATIONS = {
    "Add": np.add,
    "Cast": lambda x, to: x.astype(TYPES[to]),
    "Concat": lambda *parts, axis: np.concatenate(parts, axis),
    "Conv": conv,
    "ConvTranspose": conv_transpose,
    "Gather": lambda x, index, axis=0: np.take(x, index, axis),
    "Identity": lambda x: x,
    "LeakyRelu": lambda x, alpha: np.where(x < 0, np.float32(alpha) * x, x),
    "MatMul": np.matmul,
    "Mul": np.multiply,
    "Neg": np.negative,
    "Pad": pad,
    "Reshape": reshape,
    "Slice": slices,
    "Sub": np.subtract,
    "Tanh": np.tanh,
    "Transpose": lambda x, perm: np.transpose(x, perm),
}


def evaluate(model, patterns):
    graph = collected(model[7][0])
    values = dict(tensor(t) for t in graph[5])
    [given], [wanted] = graph[11], graph[12]
    name, kind, shape = declared(given)
    rows, columns = patterns.shape[1:]
    assert (name, kind, shape) == ("pattern", 2, ["n", rows, columns]), declared(given)
    assert declared(wanted) == ("displacement", 1, ["n", rows + 1, columns + 1, 2]), declared(wanted)
    values[name] = patterns
    for data in graph[1]:
        node = collected(data)
        inputs = [values[i.decode()] for i in node[1]]
        result = OPERATIONS[node[4][0].decode()](*inputs, **dict(attribute(a) for a in node.get(5, [])))
        assert result.dtype in TYPES.values(), (node[4], result.dtype)
        values[node[2][0].decode()] = result
    return values["displacement"]


def main(model_path, predicted_path):
    with h5py.File(predicted_path) as file:
        patterns, predicted = file["patterns"][...], file["displacement"][...]
    with open(model_path, "rb") as file:
        data = file.read()
    model = collected(data)
    opset = {o.get(1, [b""])[0]: o[2][0] for o in map(collected, model[8])}
    metadata = {e[1][0].decode(): e[2][0].decode() for e in map(collected, model[14])}
    assert opset == {b"": 17} and model[1] == [8], (opset, model[1])
    assert '"scale_mm"' in metadata["deaflow"]
    differences = {"numpy": np.abs(evaluate(model, patterns) - predicted).max()}
    try:
        import onnxruntime
    except ImportError:
        onnxruntime = None
    if onnxruntime is not None:
        session = onnxruntime.InferenceSession(data, providers=["CPUExecutionProvider"])
        [found] = session.run(None, {"pattern": patterns})
        assert found.shape == predicted.shape and found.dtype == np.float32
        # Any number of patterns.
        [one] = session.run(["displacement"], {"pattern": patterns[:1]})
        differences[f"onnxruntime {onnxruntime.__version__}"] = max(
            np.abs(found - predicted).max(), np.abs(one - predicted[:1]).max()
        )
    print("; ".join(f"{name}: {difference:.1e} mm" for name, difference in differences.items()))
    print("moved", np.abs(predicted).max())
    return int(not all(difference < TOLERANCE for difference in differences.values()))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
