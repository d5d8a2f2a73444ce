"""What `deaflow.torch` and `deaflow.jax` share: the function `solve`, what it checks, and the work on the processor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Optional, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from .scene import Scene

# The arrays of a framework.
Array = TypeVar("Array")


@dataclass(frozen=True)
class Simulation:
    """A scene and the options of its solver, which can be compared."""

    scene: Scene
    options: tuple[tuple[str, Any], ...]

    def displacement(self, coverage: Any) -> NDArray[np.float64]:
        """Return the displacement of the cell corners in mm, (n, ny + 1, nx + 1, 2)."""
        return self.scene.solve(np.asarray(coverage), **dict(self.options))["displacement"]

    def gradient(self, coverage: Any, weights: Any) -> NDArray[np.float64]:
        """Return the derivative of ``(weights * displacement).sum()`` with respect to `coverage`, of its shape."""
        return self.scene.displacement_gradient(np.asarray(coverage), np.asarray(weights), **dict(self.options))


class Solve(Protocol[Array]):
    """The function `solve` of a framework."""

    def __call__(
        self,
        scene: Scene,
        coverage: Array,
        *,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> Array: ...


def solve_by(apply: Callable[[Simulation, Any], Any], is_float: Callable[[Any], bool], module: str) -> Solve[Any]:
    """Return the function `solve` of a module.

    Parameters
    ----------
    apply : callable
        Returns the displacement by a simulation of coverages, (n, ny, nx), and tells the framework its derivative.
    is_float : callable
        Whether an array of the framework has floats.
    module : str
        The module that has the function.
    """

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

        The patterns are simulated on the processor, and once more for the gradient. It is that of the adjoint method,
        and has the accuracy of the type of `coverage`: JAX has 32 bits unless `jax_enable_x64` is set.

        Parameters
        ----------
        scene : Scene
            The device, in one state.
        coverage : tensor or array of float, (n, ny, nx) or (ny, nx)
            The share of each cell that electrodes of group 1 cover, from 0 to 1.
        elements_per_cell, order, tolerance, time_limit
            As for `Scene.solve`.

        Returns
        -------
        tensor or array, (n, ny + 1, nx + 1, 2)
            Displacement in mm, with the type and device of `coverage`; NaN without a stable solution. n is 1 if
            `coverage` has two axes.

        Raises
        ------
        TypeError
            If `coverage` does not have floats.
        ValueError
            If the scene has several states, or `coverage` has another shape.
        Error
            As for `Scene.solve`. JAX raises an error of its own that tells it.
        """
        if scene.states:
            raise ValueError(f"choose a state with `in_state`: {', '.join(scene.states)}")
        if not is_float(coverage):
            raise TypeError(f"coverage has floats, not {coverage.dtype}")
        of_patterns = coverage if coverage.ndim == 3 else coverage[None]
        if of_patterns.ndim != 3 or tuple(of_patterns.shape[1:]) != scene.shape:
            rows, columns = scene.shape
            shape = tuple(coverage.shape)
            raise ValueError(f"coverage has shape {shape}; allowed: ({rows}, {columns}) or (n, {rows}, {columns})")
        options = {
            "elements_per_cell": elements_per_cell,
            "order": order,
            "tolerance": tolerance,
            "time_limit": time_limit,
        }
        return apply(Simulation(scene, tuple(options.items())), of_patterns)

    solve.__module__, solve.__qualname__ = module, "solve"
    return solve
