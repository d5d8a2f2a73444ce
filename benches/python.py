#!/usr/bin/env python3
"""Times the Python package beside the command of the same build, by turns:

    benches/python.py [--deaflow PROGRAM] [--core PROGRAM] [--patterns 10000] [--rounds 5] [--cells 50]

With the python in which the package is installed. The pattern alone, with one and two elements along a cell: the time
of a call of `Scene.solve`, the `solve_seconds` of its result, and the difference, which is around the solver. With
`--core` also those of the same call in Rust, in turns of 20 calls, by the program that `cargo bench -p deaflow-python
--bench call --no-run` builds. Numbers are 5 % quantiles, and medians in brackets. The batch: the processor time and the
time of `deaflow solve` of a file, which also writes its result, and of a python that loads the same file and calls
`Scene.solve`; and the sums of `solve_seconds` of both. The arrays must be the same bits.
"""

import argparse
import os
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


# Calls of Python and of Rust in a turn.
TURN = 20


def timed(command):
    """The time and the processor time of a command, and what it prints."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - start, used, printed


def alone(scene, pattern, elements_per_cell, calls):
    """Milliseconds of calls and of the solver in them."""
    rows = []
    for _ in range(calls):
        start = time.perf_counter()
        found = scene.solve(pattern, elements_per_cell=elements_per_cell)
        rows.append((1e3 * (time.perf_counter() - start), 1e3 * found.solve_seconds[0]))
    return rows


class Core:
    """The same calls in Rust, in a process that waits between turns."""

    def __init__(self, program, scene, pattern, elements_per_cell):
        command = [program, scene, pattern, str(elements_per_cell)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def calls(self, count):
        self.process.stdin.write(f"{count}\n")
        self.process.stdin.flush()
        return (1e-3 * np.array(self.process.stdout.readline().split(), dtype=float).reshape(-1, 2)).tolist()

    def end(self):
        self.process.stdin.close()
        self.process.wait()


def compare_alone(path, pattern, program, file):
    """Prints the time of a single pattern in Python and in Rust."""
    pattern.tofile(file)
    scene = deaflow.Scene.read(path)
    for elements_per_cell in (1, 2):
        core = Core(program, path, file, elements_per_cell) if program else None
        rows = {"Python": [], "Rust": []}
        # The first turn prepares the solvers.
        for turn in range(51):
            of_python = alone(scene, pattern, elements_per_cell, TURN)
            of_rust = core.calls(TURN) if core else []
            if turn > 0:
                rows["Python"] += of_python
                rows["Rust"] += of_rust
        if core:
            core.end()
        quantiles = {name: np.percentile(found, [5, 50], axis=0) for name, found in rows.items() if found}
        for name, (low, middle) in quantiles.items():
            (call, solver), (middle_call, middle_solver) = low, middle
            around = np.percentile(np.array(rows[name])[:, 0] - np.array(rows[name])[:, 1], [5, 50])
            print(
                f"one pattern, {elements_per_cell} along a cell, {name}: {call:.3f} ms (median {middle_call:.3f}), in "
                f"the solver {solver:.3f} ({middle_solver:.3f}), around it {around[0]:.3f} ({around[1]:.3f})"
            )
        if core:
            more = quantiles["Python"][:, 0] - quantiles["Rust"][:, 0]
            ratio = quantiles["Python"][:, 0] / quantiles["Rust"][:, 0]
            print(f"Python less Rust: {more[0]:+.3f} ms (median {more[1]:+.3f}), ratio {ratio[0]:.3f} ({ratio[1]:.3f})")
    print(f"load {os.getloadavg()[0]:.2f}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--deaflow", default=str(Path(sys.executable).with_name("deaflow")), help="the program")
    parser.add_argument("--core", help="the program of the same call in Rust")
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
        compare_alone(scene, patterns[0], options.core, Path(name) / "pattern")
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
        print(f"load {os.getloadavg()[0]:.2f}")
        print(f"{options.patterns} patterns, medians of {options.rounds} rounds:")
        for at, what in enumerate(("time of the process", "processor time", "in the solver")):
            each = [(row[at], row[at + 3]) for row in rounds]
            ratio = median(ours / theirs for theirs, ours in each)
            theirs, ours = (median(column) for column in zip(*each))
            print(f"{what}: deaflow solve {theirs:.2f} s, Python {ours:.2f} s, ratio {ratio:.3f}")


if __name__ == "__main__":
    main()
