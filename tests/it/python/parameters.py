"""Derivatives with respect to voltages and parameters of the material are the limits of central differences."""

import copy

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
# Where each parameter is, and its value in the unit of the derivative.
PLACES = {
    "shear_modulus": ("material", "shear_modulus", 45e3, "Pa"),
    "relative_permittivity": ("material", "relative_permittivity", 4.7, None),
    "thickness": ("geometry", "thickness", 1.0, "mm"),
}
random = np.random.default_rng(4)


def slope(value, at):
    """A central difference of fourth order: its error is far below that of the derivative."""
    step = 1e-3 * abs(at) if at else 1.0
    a, b, c, d = (value(at + k * step) for k in (1, -1, 2, -2))
    return (8 * (a - b) - (c - d)) / (12 * step)


def check(found, expected, what, largest=0.0):
    assert abs(found - expected) < 1e-6 * max(abs(expected), largest), (what, found, expected)


def value_of(scene, pattern, objective, mesh):
    value, _ = deaflow.Scene(scene).value_and_gradient(pattern, objective, tolerance=1e-12, **mesh)
    return value


def check_material(scene, pattern, objective, mesh):
    of = deaflow.Scene(scene)
    _, found = of.value_and_gradient(pattern, objective, wrt=list(PLACES), tolerance=1e-12, **mesh)
    for name, (part, key, at, unit) in PLACES.items():

        def value(number):
            changed = copy.deepcopy(scene)
            changed[part][key] = number if unit is None else f"{number!r} {unit}"
            return value_of(changed, pattern, objective, mesh)

        check(found[name], slope(value, at), name)


def check_voltage(scene, volts, set_volts, pattern, objective, mesh):
    """`set_volts` returns a drive or states for an array like `volts`."""
    of = deaflow.Scene({**scene, **set_volts(volts)})
    _, found = of.value_and_gradient(pattern, objective, wrt="voltage", tolerance=1e-12, **mesh)
    found = np.asarray(found["voltage"])
    assert found.shape == volts.shape, found
    for place in np.ndindex(*volts.shape):

        def value(number):
            changed = volts.copy()
            changed[place] = number
            return value_of({**scene, **set_volts(changed)}, pattern, objective, mesh)

        if volts[place] == 0:
            assert found[place] == 0
        else:
            check(found[place], slope(value, volts[place]), place, np.abs(found).max())


def drive(volts):
    return {"drive": {"voltage": f"{float(volts)!r} V"}}


def drives(volts):
    return {"drive": {"voltages": [f"{one!r} V" for one in volts.tolist()]}}


def states(volts):
    pull, push = ([f"{one!r} V" for one in row] for row in volts.tolist())
    return {"states": {"push": {"voltages": push}, "pull": {"voltages": pull}}}


point = {"point": ["20 mm", "30 mm"], "direction": "30 deg"}
cells = random.integers(0, 2, (8, 8))
base = {"geometry": WHOLE, "material": MATERIAL}
check_material({**base, **drive(5000.0)}, cells, point, {"elements_per_cell": 2})
check_voltage(base, np.array(5000.0), drive, cells, point, {"elements_per_cell": 1, "order": 2})
stiff = {**base, "effects": {"strain_stiffening": {"model": "gent", "jm": 125}}}
check_voltage(stiff, np.array(5000.0), drive, cells, point, {"elements_per_cell": 2})
decay = {**base, "effects": {"stretch_dependent_permittivity": {"exponent": 0.1, "reference": "undeformed"}}}
check_voltage(decay, np.array(5000.0), drive, cells, point, {"elements_per_cell": 2})
target = {"point": ["20 mm", "12 mm"], "displacement": ["0.5 mm", "0.2 mm"]}
groups = random.integers(0, 3, (6, 12))
groups[2:4, 5:7] = 0
device = {"geometry": BODY, "material": MATERIAL}
check_material({**device, **drives(np.array([5000.0, 3000.0]))}, groups, target, {"elements_per_cell": 2})
turn = {"body": 0, "rotation": "counterclockwise"}
check_voltage(device, np.array([5000.0, 3000.0, 0.0]), drives, groups, turn, {"elements_per_cell": 2})
stroke = {
    "points": [
        {"body": 0, "direction": "0 deg", "state": "push"},
        {"body": 0, "direction": "180 deg", "state": "pull"},
    ]
}
of_states = np.array([[5000.0, 2000.0], [0.0, 4000.0]])
check_voltage(device, of_states, states, groups, stroke, {"elements_per_cell": 2})
check_material({**device, **states(of_states)}, groups, stroke, {"elements_per_cell": 1})
strip = {"geometry": STRIP, "material": MATERIAL}
rows = random.integers(1, 3, (4, 8))
bar = {"bar": "right", "direction": "0 deg"}
check_voltage(strip, np.array([4000.0, 3000.0]), drives, rows, bar, {"elements_per_cell": 2})

# Several patterns, with the gradient of the shares.
scene = deaflow.Scene({**base, **drive(5000.0)})
many = np.array([cells, 0 * cells])
value, both = scene.value_and_gradient(many, point, wrt=("voltage", "coverage"))
expected, of_cells = scene.value_and_gradient(many, point)
# A pattern is solved once for all derivatives.
assert np.array_equal(value, expected) and np.array_equal(both["coverage"], of_cells)
_, alone = scene.value_and_gradient(many, point, wrt="voltage")
assert np.allclose(both["voltage"], alone["voltage"], rtol=1e-6, atol=0)
assert both["voltage"].shape == (2,) and both["voltage"][1] == 0
_, unstable = deaflow.Scene({**base, **drive(14000.0)}).value_and_gradient(cells, point, wrt="voltage")
assert np.isnan(unstable["voltage"])

for wrong, call in {
    "there is no derivative with respect to `thickness` with the effects": lambda: deaflow.Scene(
        {**stiff, **drive(5000.0)}
    ).value_and_gradient(cells, point, wrt="thickness"),
    "where sides are not held": lambda: deaflow.Scene({**strip, **drives(of_states[0])}).value_and_gradient(
        rows, bar, wrt="shear_modulus"
    ),
    'with respect to "prestretch"': lambda: scene.value_and_gradient(cells, point, wrt="prestretch"),
    "wrinkling": lambda: deaflow.Scene(
        {**base, **drive(5000.0), "effects": {"wrinkling": {}}}
    ).value_and_gradient(cells, point, wrt="voltage"),
}.items():
    try:
        call()
        raise SystemExit(f"no error: {wrong}")
    except deaflow.Error as error:
        assert wrong in str(error), (wrong, str(error))
