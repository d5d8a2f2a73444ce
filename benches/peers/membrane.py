"""What the peers have in common: the patterns, the numbers of the default scene, Newton's method and the clock.

Lengths are in units of the membrane's side and stresses in units of mu lambda_p^2, so two numbers describe the scene:
a = lambda_p^-6 and b = kappa lambda_p^2. With f = I + grad u and j = det f the stress is p = f - (a j^-3 + S b j) cof f.
"""

import json
import sys
import time

import numpy as np

CELLS, SIDE_MM, PRESTRETCH = 50, 50.0, 3.0
KAPPA = 4.7 * 8.8541878128e-12 * (5250.0 / 1e-3) ** 2 / 45e3
A, B = PRESTRETCH**-6, KAPPA * PRESTRETCH**2
TOLERANCE = 1e-8


def small_grids(count, seed=1):
    """Random patterns with 1250 of 2500 cells active, (count, 50, 50), [y][x]."""
    random = np.random.default_rng(seed)
    cells = np.zeros((count, CELLS * CELLS), np.uint8)
    for row in cells:
        row[random.permutation(CELLS * CELLS)[: CELLS * CELLS // 2]] = 1
    return cells.reshape(count, CELLS, CELLS)


def newton(residual, step, u):
    """Full Newton steps until the residual is TOLERANCE times that at rest; residual(u) and step(u, r) are the peer's."""
    r = residual(u)
    reference = size = np.linalg.norm(r)
    while size > TOLERANCE * reference:
        u = u - step(u, r)
        r = residual(u)
        size = np.linalg.norm(r)
    return u


def report(code, elements, solve, patterns):
    """Times `solve` on each pattern after one unmeasured run and prints a line of JSON."""
    solve(patterns[0])
    times, largest = [], []
    for pattern in patterns:
        start = time.process_time()
        displacement = solve(pattern)
        times.append(1e3 * (time.process_time() - start))
        largest.append(float(SIDE_MM * displacement))
    print(json.dumps({"code": code, "elements": elements, "ms": min(times), "max_mm": largest}), flush=True)


if __name__ == "__main__":
    np.save(sys.argv[1], small_grids(int(sys.argv[2])))
