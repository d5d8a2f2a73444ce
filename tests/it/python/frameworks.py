"""The functions of PyTorch and JAX are differentiable, where these are installed; prints which of them are."""

import numpy as np

import deaflow

SCENE = deaflow.Scene(
    {
        "geometry": {"side": "50 mm", "thickness": "1 mm", "prestretch": 3, "cells": 5},
        "material": {"model": "neo-hookean", "shear_modulus": "45 kPa", "relative_permittivity": 4.7},
        "drive": {"voltage": "5 kV"},
    }
)
OPTIONS = {"elements_per_cell": 1, "tolerance": 1e-12}
SHARES = np.random.default_rng(8).integers(200_000_000, 800_000_000, (2, 5, 5)) / 1e9
WEIGHTS = np.random.default_rng(9).normal(size=(2, 6, 6, 2))
EXPECTED = SCENE.displacement_gradient(SHARES, WEIGHTS, **OPTIONS)


def torch():
    import torch

    import deaflow.torch

    shares = torch.tensor(SHARES, requires_grad=True)
    solve = lambda shares: deaflow.torch.solve(SCENE, shares, **OPTIONS)
    displacement = solve(shares)
    (displacement * torch.tensor(WEIGHTS)).sum().backward()
    assert np.array_equal(displacement.detach().numpy(), SCENE.solve(SHARES, **OPTIONS).displacement)
    assert np.array_equal(shares.grad.numpy(), EXPECTED)
    # Shares are rounded to 1e-9.
    assert torch.autograd.gradcheck(solve, (shares[:1],), eps=1e-4, atol=1e-5, rtol=1e-3)
    # In single precision, and where there is no stable solution.
    assert solve(shares.float()).dtype == torch.float32


def jax():
    import jax

    import deaflow.jax

    jax.config.update("jax_enable_x64", True)
    solve = lambda shares: deaflow.jax.solve(SCENE, shares, **OPTIONS)
    value = lambda shares: (solve(shares) * WEIGHTS).sum()
    displacement = solve(jax.numpy.array(SHARES))
    assert np.array_equal(np.asarray(displacement), SCENE.solve(SHARES, **OPTIONS).displacement)
    for gradient in (jax.grad(value), jax.jit(jax.grad(value))):
        assert np.array_equal(np.asarray(gradient(jax.numpy.array(SHARES))), EXPECTED)


for check in (torch, jax):
    try:
        __import__(check.__name__)
    except ImportError:
        continue
    check()
    print(check.__name__)
