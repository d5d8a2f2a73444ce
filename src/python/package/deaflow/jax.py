"""Simulations as functions of JAX: `solve` is differentiable with respect to the covered share of each cell."""

from __future__ import annotations

from functools import partial
from typing import Any

import jax

from .autodiff import Simulation, Solve, solve_by

__all__ = ["solve"]


@partial(jax.custom_vjp, nondiff_argnums=(0,))
def _solve(simulation: Simulation, coverage: Any) -> Any:
    n, ny, nx = coverage.shape
    shape = jax.ShapeDtypeStruct((n, ny + 1, nx + 1, 2), coverage.dtype)

    def on_host(shares: Any) -> Any:
        return simulation.displacement(shares).astype(shape.dtype)

    return jax.pure_callback(on_host, shape, coverage)


def _forward(simulation: Simulation, coverage: Any) -> tuple[Any, Any]:
    return _solve(simulation, coverage), coverage


def _backward(simulation: Simulation, coverage: Any, weights: Any) -> tuple[Any]:
    shape = jax.ShapeDtypeStruct(coverage.shape, coverage.dtype)

    def on_host(shares: Any, vectors: Any) -> Any:
        return simulation.gradient(shares, vectors).astype(shape.dtype)

    return (jax.pure_callback(on_host, shape, coverage, weights),)


_solve.defvjp(_forward, _backward)


def _is_float(coverage: Any) -> bool:
    return bool(jax.numpy.issubdtype(coverage.dtype, jax.numpy.floating))


solve: Solve[jax.Array] = solve_by(_solve, _is_float, __name__)
