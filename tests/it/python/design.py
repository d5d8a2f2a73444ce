"""Designs have the bits of a stage of a pipeline, and a callback is told about each generation and step."""

import os
import sys

import numpy as np

import deaflow

scene = deaflow.Scene.read("scene.yaml")
objective = {"point": ["25 mm", "25 mm"], "direction": "0 deg"}


def check(result, stage):
    artifact = deaflow.open("store", stage)
    assert list(result) == list(artifact), (list(result), list(artifact))
    for name in result:
        assert np.array_equal(result[name], artifact[name], equal_nan=artifact[name].dtype.kind == "f"), name
        assert result.units[name] == artifact.units[name] and result.dims[name] == artifact.dims[name], name
    assert result.attributes == artifact.attributes


lines = []
along = scene.design(objective, area=0.5, method="adjoint", units=20, starts=1, callback=lines.append)
check(along, "along:design")
assert lines and all(line.startswith("gradient step ") for line in lines), lines
told = np.array([float(line.split(" ")[3]) for line in lines])
for value in along["climb/value"]:
    assert np.abs(told - value).min() < 1e-3 * value, (told, value)

lines = []
disc = {"disc": {"centre": ["25 mm", "25 mm"], "radius": "3 mm"}}
options = dict(population=60, generations=3, evaluator="linear", seed=3, constraints={"keep_out": [disc]})
found = scene.design(objective, **options, store="kept", jobs=1, callback=lines.append)
check(found, "ga:design")
assert [line.split(":")[0] for line in lines] == [f"generation {k}" for k in range(4)], lines
again = scene.design(objective, **options, store="kept", callback=lines.append)
check(again, "ga:design")
assert len(lines) == 4, "the second search is reused"


def stop(line):
    raise ValueError(line)


try:
    scene.design(objective, **{**options, "seed": 4, "generations": 1000}, callback=stop)
    raise SystemExit("not stopped")
except ValueError as error:
    assert str(error).startswith("generation 0"), error
for wrong, keys in (({"point": ["25 mm", "25 mm"]}, {}), (objective, {"method": "adjoint", "populaton": 3})):
    try:
        scene.design(wrong, **keys)
        raise SystemExit("no error")
    except deaflow.Error as error:
        assert error.code == 2 and error.message, error
assert not [name for name in os.listdir() if name.startswith("deaflow-")]

# Without h5py there is no search whose result could not be read.
sys.modules["h5py"], told = None, []
try:
    scene.design(objective, callback=told.append)
    raise SystemExit("no error")
except ImportError as error:
    assert "h5py" in str(error) and not told
