"""DOLFINx 0.5, as in Debian 12: Newton's method with PETSc, by conjugate gradients with GAMG and by MUMPS' Cholesky."""

import sys

import numpy as np
import ufl
from dolfinx import fem, mesh
from dolfinx.fem import petsc
from mpi4py import MPI
from petsc4py import PETSc

from membrane import A, B, CELLS, newton, report

JIT = {"cffi_extra_compile_args": ["-O3", "-march=native"]}


def krylov(comm, kind):
    ksp = PETSc.KSP().create(comm)
    if kind == "CG+GAMG":
        ksp.setType("cg")
        ksp.getPC().setType("gamg")
        ksp.setTolerances(rtol=1e-4)
    else:
        ksp.setType("preonly")
        ksp.getPC().setType("cholesky")
        ksp.getPC().setFactorSolverType("mumps")
    return ksp


def solver(elements, kind):
    domain = mesh.create_unit_square(MPI.COMM_SELF, elements, elements, mesh.CellType.quadrilateral)
    space = fem.VectorFunctionSpace(domain, ("CG", 1))
    u, v, du = fem.Function(space), ufl.TestFunction(space), ufl.TrialFunction(space)
    s = fem.Function(fem.FunctionSpace(domain, ("DG", 0)))
    f = ufl.Identity(2) + ufl.grad(u)
    j = ufl.det(f)
    dx = ufl.dx(metadata={"quadrature_degree": 2})
    energy = (0.5 * ufl.inner(f, f) + 0.5 * A / j**2 - 0.5 * s * B * j**2) * dx
    gradient = ufl.derivative(energy, u, v)
    force = fem.form(gradient, jit_params=JIT)
    stiffness = fem.form(ufl.derivative(gradient, u, du), jit_params=JIT)

    domain.topology.create_connectivity(1, 2)
    edge = mesh.locate_entities_boundary(domain, 1, lambda x: np.full(x.shape[1], True))
    frame = fem.locate_dofs_topological(space, 1, edge)
    clamp = fem.dirichletbc(np.zeros(2), frame, space)
    held = np.concatenate([2 * frame, 2 * frame + 1])
    tangent, load = petsc.create_matrix(stiffness), petsc.create_vector(force)
    if kind == "CG+GAMG":
        x = space.tabulate_dof_coordinates()
        modes = [np.zeros(2 * len(x)) for _ in range(2)]
        for c, mode in enumerate(modes):
            mode[c::2] = 1
        basis = [PETSc.Vec().createWithArray(mode / np.linalg.norm(mode), comm=MPI.COMM_SELF) for mode in modes]
        tangent.setNearNullSpace(PETSc.NullSpace().create(vectors=basis, comm=MPI.COMM_SELF))
    ksp = krylov(MPI.COMM_SELF, kind)
    ksp.setOperators(tangent)
    change = tangent.createVecRight()
    vertices = domain.geometry.dofmap.array.reshape(-1, 4)
    column, row = np.minimum((domain.geometry.x[vertices].mean(axis=1)[:, :2].T * CELLS).astype(int), CELLS - 1)
    places = space.tabulate_dof_coordinates()[:, :2] * CELLS
    corner = np.all(np.abs(places - np.round(places)) < 1e-9, axis=1)

    def residual(values):
        u.x.array[:] = values
        with load.localForm() as local:
            local.set(0)
        petsc.assemble_vector(load, force)
        r = load.array.copy()
        r[held] = 0
        return r

    def step(values, r):
        u.x.array[:] = values
        tangent.zeroEntries()
        petsc.assemble_matrix(tangent, stiffness, bcs=[clamp])
        tangent.assemble()
        ksp.setOperators(tangent)
        load.array[:] = r
        ksp.solve(load, change)
        return change.array.copy()

    def solve(pattern):
        s.x.array[:] = pattern[row, column]
        values = newton(residual, step, np.zeros_like(u.x.array))
        return np.hypot(values[0::2], values[1::2])[corner].max()

    return solve


if __name__ == "__main__":
    patterns = np.load(sys.argv[1])
    for kind in ("CG+GAMG", "MUMPS Cholesky"):
        for per_cell, count in ((1, 4), (2, 3), (4, 2)):
            report(f"DOLFINx, {kind}", CELLS * per_cell, solver(CELLS * per_cell, kind), patterns[:count])
