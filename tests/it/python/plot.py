"""Drawings of membranes: cells where they have moved to, colours of groups, and the displacement in the title."""

import sys

import matplotlib

matplotlib.use("agg")
import numpy as np
from matplotlib.colors import to_rgb

import deaflow
from deaflow.plot import BARE, GROUPS

patterns, groups = np.load("patterns.npy"), np.load("groups.npy")
scene = deaflow.Scene.read("plain.yaml")
result = scene.solve(patterns)
axes = scene.plot(result, 1, point=(20, 30))
cells = axes.collections[0]
assert axes.get_aspect() == 1 and axes.get_xlabel() == "x, mm"
squares = np.array([path.vertices[:4] for path in cells.get_paths()]).reshape(20, 20, 4, 2)
u = result.displacement[1]
# The upper right corner of a cell.
assert np.allclose(squares[7, 3, 2], [4 * 2.5, 8 * 2.5] + u[8, 4])
colours = cells.get_facecolors()[:, :3].reshape(20, 20, 3)
assert np.allclose(colours[patterns[1] == 1], to_rgb(GROUPS[0]))
assert np.allclose(colours[patterns[1] == 0], to_rgb(BARE))
title = axes.get_title()
drawn, told = title.split("\n")
assert drawn == "pattern 1" and "(20, 30) mm: x " in told and told.endswith(" mm"), title
told = [float(part.split()[1]) for part in told.split(": ")[1].split(", ")]
assert np.allclose(told, u[12, 8], atol=1e-4), (title, u[12, 8])
# Between corners the displacement is interpolated.
assert scene.plot(result, 1, point=(21.25, 30)).get_title() != title
largest = float(scene.plot(result).get_title().split()[-2])
assert abs(largest - result.max_displacement[0]) < 1e-3 * largest

device = deaflow.Scene.read("device.yaml")
of_device = device.solve(groups)
drawn = device.plot(of_device, 1, state="push")
colours = drawn.collections[0].get_facecolors()[:, :3].reshape(10, 20, 3)
assert np.allclose(colours[groups[1] == 2], to_rgb(GROUPS[1]))
assert drawn.get_title().startswith("pattern 1, state push\nlargest displacement "), drawn.get_title()
assert drawn.get_title() != device.plot(of_device, -1, state="pull").get_title()

unstable = deaflow.Scene.read("plain.yaml", {"drive.voltage": "14 kV"}).solve(patterns[0])
drawn = scene.plot(unstable)
assert drawn.get_title() == f"pattern 0, {unstable.outcome[0]}" != "pattern 0, converged" and not drawn.collections

creep = scene.history(patterns[0], at=[0, 1.5], elements_per_cell=1)
assert scene.plot(creep).get_title().startswith("pattern 0, t = 1.5 s\n"), scene.plot(creep).get_title()
estimated = scene.solve(patterns[0], method="linear")
assert scene.plot(estimated).get_title().startswith("pattern 0, estimated\n")

half = scene.solve(patterns[0] / 2)
mixed = scene.plot(half).collections[0].get_facecolors()[:, :3]
expected = (np.array(to_rgb(BARE)) + to_rgb(GROUPS[0])) / 2
assert np.allclose(mixed.reshape(20, 20, 3)[patterns[0] == 1], expected)

for call in (
    lambda: device.plot(result),
    lambda: scene.plot(result, point=(60, 0)),
    lambda: device.plot(of_device, state="pus"),
):
    try:
        call()
        sys.exit("no error")
    except (ValueError, deaflow.NotFound):
        pass
scene.plot(result, 1).figure.savefig("plot.png")
