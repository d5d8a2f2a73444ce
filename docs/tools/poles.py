"""Fits the poles for creep from three equilibria, and tests them on other patterns, voltages and branches.

    python3 docs/tools/poles.py [DEAFLOW]

Needs numpy, scipy and h5py. Takes a minute."""
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
from scipy.optimize import minimize

DEAFLOW = sys.argv[1] if len(sys.argv) > 1 else "deaflow"
SHARES = [0, 0.25, 1]
POLES = [1.0, 3.0, 6.7]
STIFFNESS = 45 * 9.0
FITTED = (7, 20, [3000, 5250, 6000], [
    [(45, 1)],
    [(56.4, 0.82), (31.5, 10.7), (19.8, 500)],
    [(200, 1), (100, 30)],
    [(20, 0.01), (20, 1), (20, 100)],
])
HELD_OUT = (11, 16, [4500, 5800], [
    [(90, 1)],
    [(56.4, 0.82), (31.5, 10.7), (19.8, 500)],
    [(200, 1), (100, 30)],
    [(30, 0.01), (10, 1), (40, 100)],
])


def patterns(seed, n):
    """Random blocks, discs and half planes."""
    draw = np.random.default_rng(seed)
    y, x = np.mgrid[0:n, 0:n] + 0.5
    grains = [k for k in range(2, n + 1) if n % k == 0]
    for grain in (grains * 4)[:8]:
        coarse = draw.random((grain, grain)) < draw.uniform(0.25, 0.75)
        yield np.kron(coarse, np.ones((n // grain, n // grain)))
    for _ in range(4):
        centre, radius = draw.uniform(n / 4, 3 * n / 4, 2), draw.uniform(n / 7, n / 2.5)
        yield np.hypot(x - centre[0], y - centre[1]) < radius
    for _ in range(4):
        angle, off = draw.uniform(0, 2 * np.pi), draw.uniform(-n / 5, n / 5)
        yield (x - n / 2) * np.cos(angle) + (y - n / 2) * np.sin(angle) > off


def follow(folder, n, names, voltage, branches, times):
    """Returns displacements [pattern][time][y][x][component], and which patterns are always stable."""
    listed = ", ".join(f"{{ modulus: {g} kPa, time: {t} s }}" for g, t in branches)
    (folder / "scene.yaml").write_text(
        f"geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {n} }}\n"
        "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n"
        f"drive: {{ voltage: {voltage} V }}\neffects: {{ viscoelasticity: {{ branches: [{listed}] }} }}\n"
    )
    at = ", ".join(f"{t} s" for t in times)
    command = [DEAFLOW, "solve", "scene.yaml", *names, "-o", "out.h5", "--history", "--at", at, "--elements-per-cell", "1"]
    subprocess.run(command, cwd=folder, capture_output=True, check=False)
    with h5py.File(folder / "out.h5") as file:
        return file["displacement"][:], np.array([outcome in (b"converged", "converged") for outcome in file["outcome"][:]])


def measure(folder, seed, n, voltages, sets):
    """Returns histories with their equilibria: (branches, times, histories, equilibria)."""
    names = []
    for k, pattern in enumerate(patterns(seed, n)):
        names.append(f"p{k}.csv")
        np.savetxt(folder / names[-1], np.asarray(pattern, int), fmt="%d", delimiter=",")
    for branches in sets:
        total = sum(g for g, _ in branches)
        times = sorted({0.0, *(t * f for _, t in branches for f in (0.03, 0.1, 0.3, 1, 3, 10))})
        for voltage in voltages:
            moved, stable = follow(folder, n, names, voltage, branches, times)
            # A branch that relaxes in thirty years acts as a spring.
            held = [follow(folder, n, names, voltage, [(max(total * share, 1e-9), 1e9)], [0.0]) for share in SHARES]
            for _, also in held:
                stable &= also
            yield branches, times, moved[stable], [field[stable][:, 0] for field, _ in held]


def creep(pole, branches, times):
    """Returns a scalar that creeps from its instantaneous value to 1."""
    g, tau = (np.array(values, float) for values in zip(*branches))
    g = g / STIFFNESS
    rates = (pole * g / (1 + pole * g.sum()) - np.eye(len(g))) / tau[:, None]
    values, vectors = np.linalg.eig(rates)
    inverse = np.linalg.inv(vectors)
    state = lambda t: 1 - (vectors @ (np.exp(values * t) * (inverse @ np.ones(len(g))))).real
    return np.array([(1 + pole * g @ state(t)) / (1 + pole * g.sum()) for t in times])


def errors(poles, data):
    """Returns root mean square errors of all patterns at all times, in % of the largest root mean square displacement of each."""
    found = []
    for branches, times, moved, held in data:
        total = sum(g for g, _ in branches) / STIFFNESS
        matrix = np.array([[1 / (1 + total * share * pole) for pole in poles] for share in SHARES])
        weights = np.linalg.solve(matrix.T, np.array([creep(pole, branches, times) for pole in poles]))
        estimate = np.einsum("it,inabc->ntabc", weights, np.array(held))
        size = np.sqrt(np.mean(moved**2, axis=(2, 3, 4))).max(axis=1, keepdims=True)
        found.append((100 * np.sqrt(np.mean((estimate - moved) ** 2, axis=(2, 3, 4))) / size).ravel())
    found = np.concatenate(found)
    return np.sqrt(np.mean(found**2)), found.max()


with tempfile.TemporaryDirectory() as name:
    fitted, held_out = (list(measure(Path(name), *case)) for case in (FITTED, HELD_OUT))
spread = lambda p: np.exp(np.cumsum([p[0], abs(p[1]) + 0.05, abs(p[2]) + 0.05]))
best = minimize(lambda p: errors(spread(p), fitted)[0], [0, 0.9, 0.6], method="Nelder-Mead", options={"maxiter": 200, "xatol": 1e-2})
print("fitted poles", np.round(spread(best.x), 2))
for label, data in (("fitted to", fitted), ("held out", held_out)):
    print(label, "root mean square %.3f %%, largest %.3f %%" % errors(POLES, data))
