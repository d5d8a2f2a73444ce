"""Draws docs/figures/ring.png: the sweep of pipelines/ring.yaml beside the axisymmetric solution.

    python3 docs/tools/ring.py target/release/deaflow

runs the pipeline with fitted edges and with the edges of cells in a store of its own, prints the displacement of the edge of
the bare disc for each radius with its error, and draws it. The axisymmetric solution minimises the energy of the same law over
radial displacements, with 4,000 linear elements along the radius; `--check` compares it with closed solutions instead.
Needs numpy and matplotlib.
"""

import csv
import io
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

from photographs import reduce

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
PRESTRETCH, FRAME = 3.0, 20.0
# κ = ε V²/(μ H²) at 5 kV.
KAPPA = 4.7 * 8.8541878128e-12 * 5e3**2 / 45e3 / 1e-3**2


def axisymmetric(electrode, hub=0.0, count=4000):
    """Returns radii and displacements in mm of a membrane between a hub and the frame, with an electrode between two radii."""
    ends = sorted({hub, FRAME, *(r for r in electrode if hub < r < FRAME)})
    parts = [np.linspace(a, b, int(count * (b - a) / FRAME) + 2) for a, b in zip(ends, ends[1:])]
    radius = np.unique(np.concatenate(parts))
    middle, size = 0.5 * (radius[1:] + radius[:-1]), np.diff(radius)
    kappa = np.where((middle > electrode[0]) & (middle < electrode[1]), KAPPA, 0.0)
    u = np.zeros_like(radius)
    slopes = np.array([-1 / size, 1 / size]) * PRESTRETCH
    means = np.array([0.5 / middle, 0.5 / middle]) * PRESTRETCH
    weight = middle * size
    for _ in range(50):
        # W = ½(a² + b²) + ½J⁻² − ½κJ² with J = ab, its first and second derivatives.
        a = PRESTRETCH * (1 + np.diff(u) / size)
        b = PRESTRETCH * (1 + 0.5 * (u[1:] + u[:-1]) / middle)
        j = a * b
        first, second = -(j**-3) - kappa * j, 3 * j**-4 - kappa
        stress = a + first * b, b + first * a
        aa, bb, ab = 1 + second * b * b, 1 + second * a * a, first + second * a * b
        force, diagonal = np.zeros_like(u), np.zeros_like(u)
        for end in (0, 1):
            at = slice(end, len(size) + end)
            force[at] += weight * (stress[0] * slopes[end] + stress[1] * means[end])
            diagonal[at] += weight * (aa * slopes[end] ** 2 + 2 * ab * slopes[end] * means[end] + bb * means[end] ** 2)
        mixed = slopes[0] * means[1] + slopes[1] * means[0]
        beside = weight * (aa * slopes[0] * slopes[1] + ab * mixed + bb * means[0] * means[1])
        change = tridiagonal(diagonal[1:-1], beside[1:-1], -force[1:-1])
        u[1:-1] += change
        if np.abs(change).max() < 1e-13 * FRAME:
            return radius, u
    sys.exit("the axisymmetric solution does not converge")


def tridiagonal(diagonal, beside, right):
    """Solves a symmetric system with three diagonals."""
    diagonal, right = diagonal.copy(), right.copy()
    for i in range(1, len(right)):
        factor = beside[i - 1] / diagonal[i - 1]
        diagonal[i] -= factor * beside[i - 1]
        right[i] -= factor * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(len(right) - 2, -1, -1):
        right[i] = (right[i] - beside[i] * right[i + 1]) / diagonal[i]
    return right


def output(command):
    """Returns what a command prints."""
    return subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout


def swept(program, store, edges):
    """Returns the largest displacement in mm for each radius in mm."""
    run = [program, "run", "pipelines/ring.yaml", "--json", "--store", store, "--set", f"stages.drawn.edges={edges}"]
    stages = json.loads(output(run))["stages"]
    moved = next(stage["digest"] for stage in stages if stage["name"] == "moved")
    text = output([program, "show", moved, "--csv", "--store", store])
    rows = csv.DictReader(io.StringIO(text))
    return [(float(row["r"].split()[0]), float(row["max_displacement"])) for row in rows]


def check():
    """Compares with the closed solutions in src/fem/tests/fitted.rs."""
    for electrode, hub, known in [
        ((0, 10), 0, {5: 0.5241173068, 10: 1.0482346137, 15: 0.4077393084}),
        ((5, 10), 5, {8: 0.53741542, 10: 0.82860671, 15: 0.32228929}),
    ]:
        radius, u = axisymmetric(electrode, hub)
        for at, value in known.items():
            found = np.interp(at, radius, u)
            print(f"hub {hub} mm, electrode {electrode} mm, radius {at} mm: {found:.7f} mm, known {value:.7f} mm")
            assert abs(found - value) < 1e-7


def main(program):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with tempfile.TemporaryDirectory() as store:
        found = {edges: swept(str(pathlib.Path(program).resolve()), store, edges) for edges in ("fitted", "cells")}

    def exact(r):
        radius, u = axisymmetric((r, FRAME))
        return -np.interp(r, radius, u)

    print("r in mm, axisymmetric, fitted, cells, errors of both, in mm")
    for (r, fitted), (_, cells) in zip(found["fitted"], found["cells"]):
        known = exact(r)
        print(f"{r:4g}  {known:.6f}  {fitted:.6f}  {cells:.6f}  {fitted - known:+.1e}  {cells - known:+.1e}")
    figure, (above, below) = plt.subplots(2, 1, figsize=(6.4, 5.2), sharex=True, height_ratios=[2, 1], layout="constrained")
    line = np.linspace(0.5, 19.5, 77)
    above.plot(line, [exact(r) for r in line], color="0.3", label="axisymmetric solution")
    for edges, marker in (("fitted", "o"), ("cells", "s")):
        r, u = np.array(found[edges]).T
        above.plot(r, u, marker, fillstyle="none", label=f"edges: {edges}")
        below.semilogy(r, [abs(value - exact(at)) for at, value in zip(r, u)], marker, fillstyle="none")
    above.set(ylabel="inward displacement\nof the edge, mm", ylim=(0, None))
    below.set(xlabel="radius of the bare disc, mm", ylabel="error, mm")
    above.legend(frameon=False)
    path = ROOT / "docs" / "figures" / "ring.png"
    figure.savefig(path, dpi=110)
    reduce(path)


if __name__ == "__main__":
    check() if sys.argv[1:] == ["--check"] else main(*sys.argv[1:])
