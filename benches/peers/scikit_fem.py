"""scikit-fem: Newton's method with its vectorised assembly and SciPy's SuperLU."""

import sys

import numpy as np
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, ElementQuad1, ElementVector, LinearForm, MeshQuad
from skfem.helpers import ddot, grad

from membrane import A, B, CELLS, newton, report


def parts(w):
    f = grad(w["u"]) + np.eye(2)[:, :, None, None]
    j = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    cof = np.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
    return f, j, cof


@LinearForm
def force(v, w):
    f, j, cof = parts(w)
    return ddot(f - (A * j**-3 + w["s"] * B * j) * cof, grad(v))


@BilinearForm
def stiffness(du, v, w):
    f, j, cof = parts(w)
    d = grad(du)
    dcof = np.array([[d[1, 1], -d[1, 0]], [-d[0, 1], d[0, 0]]])
    change = d + (3 * A * j**-4 - w["s"] * B) * ddot(cof, d) * cof - (A * j**-3 + w["s"] * B * j) * dcof
    return ddot(change, grad(v))


def solver(elements):
    line = np.linspace(0, 1, elements + 1)
    basis = Basis(MeshQuad.init_tensor(line, line), ElementVector(ElementQuad1()), intorder=3)
    inside = basis.complement_dofs(basis.get_dofs())
    centres = basis.mesh.p[:, basis.mesh.t].mean(axis=1)
    x, y = np.minimum((centres * CELLS).astype(int), CELLS - 1)
    points = basis.dx.shape[1]

    def solve(pattern):
        s = np.repeat(pattern[y, x].astype(float)[:, None], points, axis=1)

        def full(u):
            whole = np.zeros(basis.N)
            whole[inside] = u
            return basis.interpolate(whole)

        def residual(u):
            return force.assemble(basis, u=full(u), s=s)[inside]

        def step(u, r):
            matrix = stiffness.assemble(basis, u=full(u), s=s)
            return splu(matrix[inside][:, inside].tocsc()).solve(r)

        u = np.zeros(basis.N)
        u[inside] = newton(residual, step, np.zeros(len(inside)))
        # The largest displacement at the corners of the cells, as everywhere.
        corner = np.all(np.abs(basis.mesh.p * CELLS - np.round(basis.mesh.p * CELLS)) < 1e-9, axis=0)
        return np.hypot(*u[basis.nodal_dofs])[corner].max()

    return solve


if __name__ == "__main__":
    patterns = np.load(sys.argv[1])
    for per_cell, count in ((1, 3), (2, 2), (4, 1)):
        report("scikit-fem, SuperLU", CELLS * per_cell, solver(CELLS * per_cell), patterns[:count])
