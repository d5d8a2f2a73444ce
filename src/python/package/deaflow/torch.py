"""Simulations as functions of PyTorch: `solve` is differentiable with respect to the covered share of each cell."""

from __future__ import annotations

from typing import Any

import torch

from .autodiff import Simulation, Solve, solve_by

__all__ = ["solve"]


class _Solve(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, simulation: Simulation, coverage: torch.Tensor) -> torch.Tensor:
        ctx.simulation, ctx.shares = simulation, coverage.detach().cpu().double().numpy()
        return torch.from_numpy(simulation.displacement(ctx.shares)).to(coverage)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *grad_outputs: torch.Tensor) -> tuple[None, torch.Tensor]:
        (weights,) = grad_outputs
        gradient = ctx.simulation.gradient(ctx.shares, weights.detach().cpu().double().numpy())
        return None, torch.from_numpy(gradient).to(weights)


solve: Solve[torch.Tensor] = solve_by(_Solve.apply, torch.is_floating_point, __name__)
