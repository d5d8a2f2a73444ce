"""Results have the bits, names, units and attributes of the files that the command writes."""

import sys
import warnings

import numpy as np
from files import check

import deaflow

stage = sys.argv[1]
if stage == "write":
    cells = np.random.default_rng(1).integers(0, 2, (3, 5, 5)).repeat(4, axis=1).repeat(4, axis=2).astype("u1")
    np.save("patterns.npy", cells)
    groups = np.random.default_rng(2).integers(0, 3, (2, 5, 10)).repeat(2, axis=1).repeat(2, axis=2).astype("u1")
    groups[:, 4:6, 9:11] = 0
    np.save("groups.npy", groups)
else:
    patterns, groups = np.load("patterns.npy"), np.load("groups.npy")
    plain = deaflow.Scene.read("plain.yaml")
    assert plain.shape == (20, 20) and plain.size == (50.0, 50.0) and plain.groups == 1 and plain.states == []
    count = 0
    count += check("plain.h5", plain.solve(patterns))
    count += check("plain.h5", plain.solve(patterns.astype(bool)))
    # Shares of 0 and 1 are whole cells, in any order of memory.
    count += check("plain.h5", plain.solve(np.asfortranarray(patterns.astype(float))))
    count += check("accurate.h5", plain.solve(patterns, accuracy="0.05 mm"))
    count += check("linear.h5", plain.solve(patterns, method="linear"))
    observed = deaflow.Scene.read("plain.yaml", {"drive.voltage": "6 kV", "effects.electromechanical_stability": {}})
    result = observed.solve(patterns, order=2, elements_per_cell=1, cells=True)
    count += check("observed.h5", result)
    assert result.critical_voltage.shape == (3, 2) and result.error is None
    device = deaflow.Scene.read("device.yaml")
    assert device.groups == 2 and device.states == ["pull", "push"] and device.shape == (10, 20)
    result = device.solve(groups, checks=True)
    count += check("device.h5", result)
    assert result.displacement.shape == (2, 2, 11, 21, 2) and result.body_translation.shape[:2] == (2, 2)
    count += check("pull.h5", device.in_state("pull").solve(groups, tolerance=1e-10))
    grey = np.load("grey.npy")
    count += check("grey.h5", plain.solve(1.0 - grey / 255.0))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        deaflow.Scene.read("plain.yaml", {"drive.voltage": 4000})
        deaflow.Scene.read("plain.yaml")
    assert [warning.filename for warning in caught] == [__file__], caught
    assert "as 4000 V" in str(caught[0].message), caught[0]
    print(count)
