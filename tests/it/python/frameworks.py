"""The functions of PyTorch and JAX are differentiable, where these are installed; prints which of them are."""

import numpy as np

import deaflow

GIVEN = {
    "material": {"model": "neo-hookean", "shear_modulus": "45 kPa", "relative_permittivity": 4.7},
    "drive": {"voltage": "5 kV"},
}
SCENE = deaflow.Scene({"geometry": {"side": "50 mm", "thickness": "1 mm", "prestretch": 3, "cells": 5}, **GIVEN})
OPTIONS = {"elements_per_cell": 1, "tolerance": 1e-12}
SHARES = np.random.default_rng(8).integers(200_000_000, 800_000_000, (2, 5, 5)) / 1e9
WEIGHTS = np.random.default_rng(9).normal(size=(2, 6, 6, 2))
EXPECTED = SCENE.displacement_gradient(SHARES, WEIGHTS, **OPTIONS)

WITH_BODY = {
    "size": ["60 mm", "30 mm"],
    "thickness": "1 mm",
    "prestretch": 3,
    "cells": [12, 6],
    "bodies": [{"rectangle": [["25 mm", "10 mm"], ["35 mm", "20 mm"]]}],
}
OPENING = {"opening": {"disc": {"centre": ["30 mm", "15 mm"], "radius": "14 mm"}}}
FRAMED = deaflow.Scene({"geometry": {**WITH_BODY, "frame": OPENING}, **GIVEN})
STATES = deaflow.Scene(
    {
        "geometry": WITH_BODY,
        "material": GIVEN["material"],
        "states": {"push": {"voltages": ["5.25 kV", "0 V"]}, "pull": {"voltages": ["0 V", "5.25 kV"]}},
    }
)
# A membrane, one with a frame and a body, and one with two electrode groups and states.
DEVICES = {"plain": SCENE, "framed": FRAMED, "in a state": STATES.in_state("push")}


def of_device(device):
    """Shares of one pattern of a device."""
    return np.random.default_rng(3).integers(200_000_000, 800_000_000, (1, *device.shape)) / 1e9


def refuses(solve, array):
    """Checks that a function tells what is wrong before it simulates."""
    for scene, coverage, error, word in (
        (STATES, np.full((1, 6, 12), 0.5), ValueError, "in_state"),
        (SCENE, np.ones((1, 5, 5), dtype=int), TypeError, "floats"),
        (SCENE, np.ones((1, 5, 6)), ValueError, "(n, 5, 5)"),
        (SCENE, np.ones((1, 1, 5, 5)), ValueError, "(n, 5, 5)"),
    ):
        try:
            solve(scene, array(coverage))
        except error as found:
            assert word in str(found), found
        else:
            raise SystemExit(f"no error with {coverage.shape}")


def torch():
    import torch

    import deaflow.torch

    shares = torch.tensor(SHARES, requires_grad=True)
    solve = lambda shares: deaflow.torch.solve(SCENE, shares, **OPTIONS)
    displacement = solve(shares)
    (displacement * torch.tensor(WEIGHTS)).sum().backward()
    assert np.array_equal(displacement.detach().numpy(), SCENE.solve(SHARES, **OPTIONS).displacement)
    assert np.array_equal(shares.grad.numpy(), EXPECTED)
    # Of one pattern.
    one = torch.tensor(SHARES[0], requires_grad=True)
    (solve(one)[0] * torch.tensor(WEIGHTS[0])).sum().backward()
    assert np.array_equal(one.grad.numpy(), EXPECTED[0])
    for name, device in DEVICES.items():
        of_shares = lambda shares: deaflow.torch.solve(device, shares, **OPTIONS)
        shares = torch.tensor(of_device(device), requires_grad=True)
        # Shares are rounded to 1e-9.
        assert torch.autograd.gradcheck(of_shares, (shares,), eps=1e-4, atol=1e-5, rtol=1e-3), name
    refuses(deaflow.torch.solve, torch.tensor)
    # In single precision, and where there is no stable solution.
    assert solve(torch.tensor(SHARES).float()).dtype == torch.float32


def jax():
    import jax
    from jax.test_util import check_grads

    import deaflow.jax

    jax.config.update("jax_enable_x64", True)
    solve = lambda shares: deaflow.jax.solve(SCENE, shares, **OPTIONS)
    value = lambda shares: (solve(shares) * WEIGHTS).sum()
    displacement = solve(jax.numpy.array(SHARES))
    assert np.array_equal(np.asarray(displacement), SCENE.solve(SHARES, **OPTIONS).displacement)
    for gradient in (jax.grad(value), jax.jit(jax.grad(value))):
        assert np.array_equal(np.asarray(gradient(jax.numpy.array(SHARES))), EXPECTED)
    of_one = jax.grad(lambda shares: (solve(shares)[0] * WEIGHTS[0]).sum())
    assert np.array_equal(np.asarray(of_one(jax.numpy.array(SHARES[0]))), EXPECTED[0])
    for device in DEVICES.values():
        of_shares = lambda shares: deaflow.jax.solve(device, shares, **OPTIONS)
        check_grads(of_shares, (jax.numpy.array(of_device(device)),), 1, ["rev"], atol=1e-5, rtol=1e-3, eps=1e-4)
    refuses(deaflow.jax.solve, jax.numpy.array)


for check in (torch, jax):
    try:
        __import__(check.__name__)
    except ImportError:
        continue
    check()
    print(check.__name__)
