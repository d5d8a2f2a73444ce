"""Simulations as functions of JAX: `solve` is differentiable with respect to the covered share of each cell."""

from __future__ import annotations

from functools import partial
from typing import Any, Optional

import jax
import numpy as np

from .scene import Scene

__all__ = ["solve"]

# What `Scene.solve` is given, in a form that can be compared.
Options = tuple[tuple[str, Any], ...]


@partial(jax.custom_vjp, nondiff_argnums=(0, 1))
def _solve(scene: Scene, options: Options, coverage: Any) -> Any:
    n, ny, nx = coverage.shape
    shape = jax.ShapeDtypeStruct((n, ny + 1, nx + 1, 2), coverage.dtype)

    def on_host(shares: Any) -> Any:
        return scene.solve(np.asarray(shares), **dict(options)).displacement.astype(shape.dtype)

    return jax.pure_callback(on_host, shape, coverage)


def _forward(scene: Scene, options: Options, coverage: Any) -> tuple[Any, Any]:
    return _solve(scene, options, coverage), coverage


def _backward(scene: Scene, options: Options, coverage: Any, weights: Any) -> tuple[Any]:
    shape = jax.ShapeDtypeStruct(coverage.shape, coverage.dtype)

    def on_host(shares: Any, vectors: Any) -> Any:
        gradient = scene.displacement_gradient(np.asarray(shares), np.asarray(vectors), **dict(options))
        return gradient.astype(shape.dtype)

    return (jax.pure_callback(on_host, shape, coverage, weights),)


_solve.defvjp(_forward, _backward)


def solve(
    scene: Scene,
    coverage: Any,
    *,
    elements_per_cell: Optional[int] = None,
    order: Optional[int] = None,
    tolerance: Optional[float] = None,
    time_limit: Optional[str] = None,
) -> Any:
    """Simulate patterns and return the displacement of the cell corners.

    The patterns are simulated on the host, and once more for the gradient. It is that of the adjoint method, and has
    the accuracy of the type of `coverage`: 32 bits unless `jax_enable_x64` is set.

    Parameters
    ----------
    scene : Scene
        The device, in one state.
    coverage : array of float, (n, ny, nx)
        The share of each cell that electrodes of group 1 cover, from 0 to 1.
    elements_per_cell, order, tolerance, time_limit
        As for `Scene.solve`.

    Returns
    -------
    array, (n, ny + 1, nx + 1, 2)
        Displacement in mm; NaN without a stable solution.
    """
    options = {"elements_per_cell": elements_per_cell, "order": order, "tolerance": tolerance, "time_limit": time_limit}
    return _solve(scene, tuple(options.items()), coverage)
