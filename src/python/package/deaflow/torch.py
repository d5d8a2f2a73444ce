"""Simulations as functions of PyTorch: `solve` is differentiable with respect to the covered share of each cell."""

from __future__ import annotations

from typing import Any, Optional

import torch

from .scene import Scene

__all__ = ["solve"]


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, coverage: torch.Tensor, scene: Scene, options: dict[str, Any]) -> torch.Tensor:
        shares = coverage.detach().cpu().double().numpy()
        ctx.shares, ctx.scene, ctx.options = shares, scene, options
        return torch.from_numpy(scene.solve(shares, **options).displacement).to(coverage)

    @staticmethod
    def backward(ctx: Any, *grad_outputs: torch.Tensor) -> tuple[Optional[torch.Tensor], None, None]:
        (weights,) = grad_outputs
        vectors = weights.detach().cpu().double().numpy()
        gradient = ctx.scene.displacement_gradient(ctx.shares, vectors, **ctx.options)
        return torch.from_numpy(gradient).to(weights), None, None


def solve(
    scene: Scene,
    coverage: torch.Tensor,
    *,
    elements_per_cell: Optional[int] = None,
    order: Optional[int] = None,
    tolerance: Optional[float] = None,
    time_limit: Optional[str] = None,
) -> torch.Tensor:
    """Simulate patterns and return the displacement of the cell corners.

    The patterns are simulated on the processor, and once more for the gradient. It is that of the adjoint method.

    Parameters
    ----------
    scene : Scene
        The device, in one state.
    coverage : tensor of float, (n, ny, nx)
        The share of each cell that electrodes of group 1 cover, from 0 to 1.
    elements_per_cell, order, tolerance, time_limit
        As for `Scene.solve`.

    Returns
    -------
    tensor, (n, ny + 1, nx + 1, 2)
        Displacement in mm, with the type and device of `coverage`; NaN without a stable solution.
    """
    options = {"elements_per_cell": elements_per_cell, "order": order, "tolerance": tolerance, "time_limit": time_limit}
    displacement: torch.Tensor = _Solve.apply(coverage, scene, options)
    return displacement
