#!/usr/bin/env python3
"""Times the Python package beside the command of the same build, by turns:

    benches/python.py [--deaflow PROGRAM] [--patterns 10000] [--rounds 5] [--cells 50]

With the python in which the package is installed. The pattern alone: the time of a call of `Scene.solve` less the
`solve_seconds` of its result, so all that is around the solver: options, threads, arrays in Rust and in Python. The batch:
the processor time and the time of `deaflow solve` of a file, which also writes its result, and of a python that loads
the same file and calls `Scene.solve`; and the sums of `solve_seconds` of both. The arrays must be the same bits.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import h5py
import numpy as np

import deaflow

SCENE = """geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {cells} }}
material: {{ model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }}
drive: {{ voltage: 5.25 kV }}
effects: {{}}
"""
LOADED = """import sys, deaflow, numpy as np
found = deaflow.Scene.read(sys.argv[1]).solve(np.load(sys.argv[2]), elements_per_cell=1)
print(found.solve_seconds.sum())
"""


def timed(command):
    """The time and the processor time of a command, and what it prints."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - start, used, printed


def alone(scene, pattern, calls):
    """Milliseconds of calls, and of what is around the solver."""
    whole, around = [], []
    for _ in range(calls):
        start = time.perf_counter()
        found = scene.solve(pattern, elements_per_cell=1)
        whole.append(1e3 * (time.perf_counter() - start))
        around.append(whole[-1] - 1e3 * found.solve_seconds[0])
    return whole, around


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--deaflow", default=str(Path(sys.executable).with_name("deaflow")), help="the program")
    parser.add_argument("--patterns", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cells", type=int, default=50)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        scene, file, out = (Path(name) / own for own in ("scene.yaml", "patterns.npy", "out.h5"))
        scene.write_text(SCENE.format(cells=options.cells))
        shape = (options.patterns, options.cells, options.cells)
        patterns = np.random.default_rng(1).integers(0, 2, shape, dtype=np.uint8)
        np.save(file, patterns)
        whole, around = alone(deaflow.Scene.read(scene), patterns[0], 1000)
        for what, numbers in (("one pattern", whole), ("of which not the solver", around)):
            low, middle = np.percentile(numbers, [1, 50])
            print(f"{what}: {low:.3f} ms (1st percentile of 1000 calls), {middle:.3f} ms (median)", flush=True)
        command = [options.deaflow, "solve", scene, file, "-o", out, "--no-checks", "--elements-per-cell", "1"]
        rounds = []
        for _ in range(options.rounds):
            out.unlink(missing_ok=True)
            theirs = timed(command)
            with h5py.File(out) as found:
                of_command = found["solve_seconds"][()].sum()
            ours = timed([sys.executable, "-c", LOADED, scene, file])
            rounds.append([*theirs[:2], of_command, *ours[:2], float(ours[2])])
        with h5py.File(out) as found:
            first = found["displacement"][: min(100, options.patterns)]
        assert np.array_equal(first, deaflow.Scene.read(scene).solve(patterns[:100], elements_per_cell=1).displacement)
        print(f"{options.patterns} patterns, medians of {options.rounds} rounds:")
        for at, what in enumerate(("time of the process", "processor time", "in the solver")):
            each = [(row[at], row[at + 3]) for row in rounds]
            ratio = median(ours / theirs for theirs, ours in each)
            theirs, ours = (median(column) for column in zip(*each))
            print(f"{what}: deaflow solve {theirs:.2f} s, Python {ours:.2f} s, ratio {ratio:.3f}")


if __name__ == "__main__":
    main()
