"""Compares results with the files that the command writes: bits, names, units and attributes."""

import h5py
import numpy as np


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def check(file, result):
    with h5py.File(file) as f:
        expected = {}

        def look(name, item):
            if isinstance(item, h5py.Dataset) and "CLASS" not in item.attrs and not name.startswith("provenance"):
                expected[name] = item

        f.visititems(look)
        assert sorted(expected) == list(result), (sorted(expected), list(result))
        for name, item in expected.items():
            values = item[...]
            if values.dtype.kind == "S":
                # An empty array has no type of its own in older versions of numpy.
                values = np.char.decode(values, "utf-8").astype(str)
            own = result[name]
            assert own.shape == values.shape and own.dtype.kind == values.dtype.kind, (name, own.shape, own.dtype)
            if name != "solve_seconds":
                assert own.tobytes() == values.astype(own.dtype).tobytes(), (file, name)
            assert result.units[name] == text(item.attrs["units"]), name
            assert result.descriptions[name] == text(item.attrs["description"]), name
            assert result.dims[name] == tuple(text(axis) for axis in item.attrs["axes"]), name
        attributes = {name: text(value) for name, value in f.attrs.items()}
        for name, item in f.get("long_attributes", {}).items():
            attributes[name] = item[()].tobytes().decode()
        assert result.attributes == attributes, (result.attributes, attributes)
    return len(expected)
