"""FElupe (PyPI): creep of one pattern, by the same steps as ours: an exponential trapezoid for each branch, Newton's method with SciPy's
sparse LU in each. Beside `deaflow solve --history` on the same mesh:

    python3 felupe_creep.py ELEMENTS PATTERNS DEAFLOW"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import felupe as fem
import h5py
import numpy as np

from membrane import A, B, CELLS, PRESTRETCH, SIDE_MM, TOLERANCE, small_grids


class Creeping:
    """w + g/2 (P : C + P33/J^2): stress and elasticity of the step, with coefficients at each quadrature point."""

    def __init__(self, load):
        self.load, self.p = load, None
        # What FElupe looks at: the field and its state variables.
        self.x = [np.eye(2), np.zeros(0)]

    def parts(self, f):
        j = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
        cof = np.array([[f[1, 1], -f[1, 0]], [-f[0, 1], f[0, 0]]])
        return j, cof

    def gradient(self, x):
        f, state = x[0], x[-1]
        j, cof = self.parts(f)
        xx, xy, yy, zz = self.p
        stress = f - ((A + zz) / j**3 + self.load * B * j) * cof
        stress += np.array([[f[0, 0] * xx + f[0, 1] * xy, f[0, 0] * xy + f[0, 1] * yy],
                            [f[1, 0] * xx + f[1, 1] * xy, f[1, 0] * xy + f[1, 1] * yy]])
        return [stress, state]

    def hessian(self, x):
        f = x[0]
        j, cof = self.parts(f)
        xx, xy, yy, zz = self.p
        metric = np.array([[1 + xx, xy], [xy, 1 + yy]])
        eye, swap = np.eye(2), np.array([[0, 1], [-1, 0]])
        lead = 3 * (A + zz) / j**4 - self.load * B
        tail = -((A + zz) / j**3 + self.load * B * j)
        tangent = np.einsum("ik,jl...->ijkl...", eye, metric)
        tangent = tangent + lead * np.einsum("ij...,kl...->ijkl...", cof, cof)
        # The derivative of the cofactor: e_ik e_jl.
        return [tangent + tail * np.einsum("ik,jl->ijkl", swap, swap)[..., None, None]]


def metric(f):
    """c^-1 (xx, xy, yy) and j^2."""
    j = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    cxx = f[0, 0] ** 2 + f[1, 0] ** 2
    cxy = f[0, 0] * f[0, 1] + f[1, 0] * f[1, 1]
    cyy = f[0, 1] ** 2 + f[1, 1] ** 2
    return np.array([cyy, -cxy, cxx, j**2 * j**2]) / j**2


def creep(elements, pattern, branches, times):
    mesh = fem.Rectangle(n=elements + 1)
    region = fem.RegionQuad(mesh)
    field = fem.FieldContainer([fem.Field(region, dim=2)])
    edge = np.isin(mesh.points, (0.0, 1.0)).any(axis=1)
    boundaries = {"frame": fem.Boundary(field[0], mask=edge)}
    centres = mesh.points[mesh.cells].mean(axis=1)
    column, row = np.minimum((centres * CELLS).astype(int), CELLS - 1).T
    load = pattern[row, column].astype(float)[None, :]
    dof0, dof1 = fem.dof.partition(field, boundaries)
    umat = Creeping(load)
    solid = fem.SolidBody(umat, field)
    before = metric(field.extract(grad=True, sym=False, add_identity=True)[0])
    states = [before.copy() for _ in branches]
    now, solves = 0.0, 0
    moved = []
    for end in times:
        step, now = end - now, end
        umat.p = 0
        for (g, tau), state in zip(branches, states):
            r = step / tau
            kept = np.exp(-r)
            mean = -np.expm1(-r) / r if r > 1e-9 else 1.0
            umat.p = umat.p + g * (kept * state + (mean - kept) * before)
        while True:
            residual = solid.assemble.vector(field).toarray().ravel()
            size = np.linalg.norm(residual[dof1])
            if size <= TOLERANCE * B:
                break
            tangent = solid.assemble.matrix(field)
            system = fem.solve.partition(field, tangent, dof1, dof0, r=residual.reshape(-1, 1))
            field += fem.solve.solve(*system)
            solves += 1
        after = metric(field.extract(grad=True, sym=False, add_identity=True)[0])
        for (g, tau), state in zip(branches, states):
            r = step / tau
            kept = np.exp(-r)
            mean = -np.expm1(-r) / r if r > 1e-9 else 1.0
            state[:] = kept * state + (mean - kept) * before + (1 - mean) * after
        before = after
        moved.append(SIDE_MM * np.hypot(*field[0].values.T).max())
    return moved, solves


def ours(program, pattern, elements, branches, times):
    """The same by `deaflow solve --history`, which picks its steps itself: the largest displacements and the seconds of a core."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        np.savetxt(folder / "pattern.csv", pattern, fmt="%d", delimiter=",")
        listed = ", ".join(f"{{ modulus: {g * 45e3 * PRESTRETCH**2} Pa, time: {tau} s }}" for g, tau in branches)
        (folder / "scene.yaml").write_text(
            f"geometry: {{ side: {SIDE_MM} mm, thickness: 1 mm, prestretch: {PRESTRETCH}, cells: {CELLS} }}\n"
            "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n"
            "drive: { voltage: 5250 V }\n"
            f"effects: {{ viscoelasticity: {{ branches: [{listed}] }} }}\n"
        )
        at = f"0 s, {times[-1]} s"
        mesh = ["--elements-per-cell", str(elements // CELLS)]
        command = [program, "solve", "scene.yaml", "pattern.csv", "-o", "out.h5", "--history", "--at", at, *mesh]
        subprocess.run(command, cwd=folder, capture_output=True, check=True)
        with h5py.File(folder / "out.h5") as file:
            return file["max_displacement"][0], file["solve_seconds"][0], file["error_in_time"][0]


if __name__ == "__main__":
    elements, count, program = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
    branches = [(1 / 9, 1.0)]
    # At once, then 40 steps that grow to 60 relaxation times.
    times = [1e-9, *np.geomspace(0.02, 60, 40)]
    for pattern in small_grids(count):
        start = time.perf_counter()
        moved, solves = creep(elements, pattern, branches, times)
        theirs = time.perf_counter() - start
        found, seconds, error = ours(program, pattern, elements, branches, times)
        apart = max(abs(moved[0] / found[0] - 1), abs(moved[-1] / found[1] - 1))
        print(
            f"{elements}² elements: FElupe {theirs:.2f} s ({len(times)} steps, {solves} linear solves), deaflow {seconds:.3f} s to {error:.0e} mm in time: "
            f"{theirs / seconds:.0f} times; displacements at once and at last agree to {apart:.1e}"
        )
