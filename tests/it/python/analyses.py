"""Histories, paths, modes, responses and equilibria in space have the bits of the files of the command."""

import numpy as np
from files import check

import deaflow

patterns = np.load("few.npy")
moving = deaflow.Scene.read("moving.yaml")
count = 0
history = moving.history(patterns, at=[10.0, 0, 1], elements_per_cell=1)
count += check("history.h5", history)
assert history.time.tolist() == [0, 1, 10] and history.displacement.shape == (2, 3, 11, 11, 2)
count += check("history.h5", moving.history(patterns.astype(bool), at="0 s, 1 s, 10 s", elements_per_cell=1))
count += check("every.h5", moving.history(patterns[:1], every=5, accuracy="0.05 mm", time_limit="100 s"))
count += check("every.h5", moving.history(patterns[:1], every="5 s", accuracy="0.05 mm", time_limit="100 s"))

path = moving.path(patterns)
count += check("path.h5", path)
assert len(path.point_offsets) == 3 and path.limit_voltage.shape == (2,)
pulled = deaflow.Scene.read("bar.yaml")
rows = np.ones((4, 8), dtype=int)
count += check("load.h5", pulled.path(rows, "load", elements_per_cell=2, tolerance=1e-9))

modes = moving.modes(patterns, 3, lumped=True)
count += check("modes.h5", modes)
assert modes.modes.shape == (2, 3, 11, 11, 2) and any("relaxed" in line for line in modes.warnings), modes.warnings

response = moving.response(patterns, "1 Hz:100 Hz", points=5, elements_per_cell=1)
count += check("response.h5", response)
again = moving.response(patterns, response.frequency, elements_per_cell=1)
count += check("response.h5", again)
one = moving.response(patterns, [10], elements_per_cell=1)
assert np.array_equal(one.response_real[:, 0], response.response_real[:, 2]), "10 Hz"

blown = deaflow.Scene.read("moving.yaml", {"loads": {"pressure": "500 Pa"}})
space = blown.solve(patterns, elements_per_cell=1, order=2)
count += check("space.h5", space)
assert space.displacement.shape == (2, 11, 11, 3) and space.dims["displacement"][-1] == "xyz"
filled = deaflow.Scene.read("moving.yaml", {"loads": {"volume": "8 ml"}})
count += check("volume.h5", filled.path(patterns[0], "volume"))
print(count)
