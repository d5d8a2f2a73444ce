"""Predictions have the bits of the files of the command, with and without intervals."""

import h5py
from files import check

import deaflow

with h5py.File("out.h5") as file:
    patterns = file["patterns"][...]
model = deaflow.Model.read("tiny.yaml:surrogate")
assert model.shape == (50, 50) and model.scene is not None, model
objective = {"point": ["20 mm", "25 mm"], "direction": "0 deg"}
result = model.predict(patterns, objectives=[objective], scene=deaflow.Scene.read("tiny.yaml"))
count = check("out.h5", result)
assert result["interval/radius"].shape == (2,) and result["interval/out_of_distribution"].tolist() == [0, 1], result
again = deaflow.Model.read("surrogate", calibration="intervals", store="store")
count += check("plain.h5", again.predict(patterns))
for wrong in (lambda: model.predict(patterns[:, :20]), lambda: deaflow.Model.read("surrogat")):
    try:
        wrong()
        raise SystemExit("no error")
    except deaflow.Error as error:
        assert error.code == 2, error
try:
    deaflow.Model.read("out.h5")
    raise SystemExit("no error")
except deaflow.Error as error:
    assert error.code == 2 and error.message == "out.h5 is a file of displacements, not a model", error
try:
    model.predict(patterns, scene=deaflow.Scene.read("tiny.yaml", {"drive.voltage": "1 kV"}))
    raise SystemExit("no error")
except deaflow.Error as error:
    assert "voltage" in str(error) or "scene" in str(error), error
print(count)
