"""The gradient is the limit of central differences, for each of three devices."""

import numpy as np

import deaflow

MATERIAL = {"model": "neo-hookean", "shear_modulus": "45 kPa", "relative_permittivity": 4.7}
WHOLE = {"side": "50 mm", "thickness": "1 mm", "prestretch": 3, "cells": 8}
BODY = {
    "size": ["60 mm", "30 mm"],
    "thickness": "1 mm",
    "prestretch": 3,
    "cells": [12, 6],
    "bodies": [{"rectangle": [["25 mm", "10 mm"], ["35 mm", "20 mm"]]}],
}
STRIP = {
    "size": ["40 mm", "20 mm"],
    "thickness": "1 mm",
    "prestretch": [2.5, 2],
    "cells": [8, 4],
    "sides": {"right": {"bar": {"load": ["0.3 N", "0 N"], "moves": ["x"]}}, "top": "free", "bottom": "roller"},
}
random = np.random.default_rng(3)


def shares(shape):
    # Multiples of what shares are rounded to, away from 0 and 1, of which no two sums are equal.
    return random.integers(200_000_000, 800_000_000, shape) / 1e9


def check(geometry, drive, objective, mesh, groups=None):
    scene = deaflow.Scene({"geometry": geometry, "material": MATERIAL, "drive": drive})
    at = shares(scene.shape)
    options = dict(objective=objective, tolerance=1e-12, **mesh)

    def compute(at):
        if groups is None:
            return scene.value_and_gradient(at, **options)
        return scene.value_and_gradient(groups, coverage=at, **options)

    value, gradient = compute(at)
    assert isinstance(value, float) and gradient.shape == scene.shape and np.isfinite(gradient).all()
    # Normals of edges turn with a kink where an estimate changes: a larger step could contain one.
    step = 2e-4
    largest = np.abs(gradient).max()
    moved = []
    cells = [tuple(cell) for cell in np.argwhere(np.abs(gradient) > 0)]
    chosen = [cells[k] for k in random.choice(len(cells), 6, replace=False)]
    for cell in chosen:
        for k in (1, -1, 2, -2):
            other = at.copy()
            other[cell] = round(other[cell] + k * step, 9)
            moved.append(other)
    moved = np.array(moved)
    if groups is None:
        values, _ = scene.value_and_gradient(moved, **options)
    else:
        values, _ = scene.value_and_gradient(np.repeat(groups[None], len(moved), 0), coverage=moved, **options)
    for cell, (a, b, c, d) in zip(chosen, values.reshape(-1, 4)):
        # Fourth order: its error is far below that of the gradient.
        slope = (8 * (a - b) - (c - d)) / (12 * step)
        assert abs(slope - gradient[cell]) < 1e-6 * largest, (cell, slope, gradient[cell], largest)
    return value, gradient, scene


point = {"point": ["20 mm", "30 mm"], "direction": "30 deg"}
value, gradient, scene = check(WHOLE, {"voltage": "5 kV"}, point, {"elements_per_cell": 1, "order": 2})
# The value is the displacement that `solve` finds.
at = shares(scene.shape)
value, _ = scene.value_and_gradient(at, {"point": ["18.75 mm", "25 mm"], "direction": "90 deg"})
assert abs(value - scene.solve(at).displacement[0, 4, 3, 1]) < 1e-12, value

check(BODY, {"voltage": "5 kV"}, {"body": 0, "rotation": "counterclockwise"}, {"elements_per_cell": 2})
target = {"point": ["20 mm", "12 mm"], "displacement": ["0.5 mm", "0.2 mm"]}
check(BODY, {"voltage": "5 kV"}, target, {"elements_per_cell": 1, "order": 2})

# A body whose border elements follow moves as `solve` says: corners of its cells outside of the border do not move with it.
def disc(radius):
    return {"disc": {"centre": ["25 mm", "25 mm"], "radius": radius}}


hub = dict(WHOLE, cells=20, frame={"opening": disc("20 mm"), "curves": "fitted"})
hub["bodies"] = [dict(disc("5 mm"), curves="fitted")]
hub = deaflow.Scene({"geometry": hub, "material": MATERIAL, "drive": {"voltage": "5 kV"}})
pattern = np.zeros((20, 20), dtype=int)
pattern[4:9, 9:16] = pattern[12:16, 3:8] = 1
mesh = {"elements_per_cell": 1, "order": 2}
solved = hub.solve(pattern, **mesh)
value, _ = hub.value_and_gradient(pattern, {"body": 0, "direction": "90 deg"}, **mesh)
assert abs(value - solved.body_translation[0, 0, 1]) < 1e-9 and value > 0.1, value
value, _ = hub.value_and_gradient(pattern, {"body": 0, "rotation": "counterclockwise"}, **mesh)
# The arc of the outermost corner, 2.5 mm beside and above the centre.
assert abs(value - np.hypot(2.5, 2.5) * np.radians(solved.body_rotation[0, 0])) < 1e-9 and abs(value) > 1e-3, value

# The value of an area is that of the polygon of the deformed corners, by the formula of Gauss.
region = {"region": {"rectangle": [["30 mm", "5 mm"], ["50 mm", "20 mm"]]}, "area_strain": "largest"}
_, _, device = check(BODY, {"voltage": "5 kV"}, region, {"elements_per_cell": 1, "order": 2})
pattern = np.zeros((6, 12), dtype=int)
pattern[1:4, 6:10] = 1
value, _ = device.value_and_gradient(pattern, region, elements_per_cell=1, order=2)
u = device.solve(pattern, elements_per_cell=1, order=2).displacement[0]
corners = [(1, i) for i in range(6, 10)] + [(j, 10) for j in range(1, 4)]
corners += [(4, i) for i in range(10, 6, -1)] + [(j, 6) for j in range(4, 1, -1)]
x, y = np.array([[5.0 * i, 5.0 * j] + u[j, i] for j, i in corners]).T
area = 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
assert abs(value - (np.sqrt(area / np.pi) - np.sqrt(300 / np.pi))) < 1e-9 and value > 0.2, value

groups = random.integers(1, 3, (4, 8))
bar = {"bar": "right", "direction": "0 deg"}
check(STRIP, {"voltages": ["4 kV", "3 kV"]}, bar, {"elements_per_cell": 2}, groups)

# The gradient of a weighted sum of displacements is that of the same objective.
weights = np.zeros((9, 9, 2))
weights[4, 3, 1] = 1
_, expected = scene.value_and_gradient(at, {"point": ["18.75 mm", "25 mm"], "direction": "90 deg"})
found = scene.displacement_gradient(at, weights)
assert np.allclose(found, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())

# Whole cells have the slope towards a partial cover.
cells = np.zeros((2, *scene.shape), dtype=int)
cells[0, 2:6, 3:] = 1
values, gradients = scene.value_and_gradient(cells, point, elements_per_cell=1, order=2, tolerance=1e-12)
assert values.shape == (2,) and gradients.shape == cells.shape and values[1] == 0
for cell in [(2, 3), (3, 5), (1, 4), (6, 6)]:
    more = cells[0].astype(float)
    sign = 1 - 2 * cells[0][cell]
    slopes = []
    for step in (1e-3, 2e-3):
        more[cell] = cells[0][cell] + sign * step
        changed, _ = scene.value_and_gradient(more, point, elements_per_cell=1, order=2, tolerance=1e-12)
        slopes.append(sign * (changed - values[0]) / step)
    slope = 2 * slopes[0] - slopes[1]
    assert abs(slope - gradients[0][cell]) < 1e-4 * np.abs(gradients[0]).max(), (cell, slope, gradients[0][cell])

# Without a stable solution there is no gradient.
unstable = deaflow.Scene({"geometry": WHOLE, "material": MATERIAL, "drive": {"voltage": "14 kV"}})
value, gradient = unstable.value_and_gradient(cells[0], point)
assert np.isnan(value) and np.isnan(gradient).all()
