#!/usr/bin/env python3
"""Times devices with free sides, bars and rollers beside clamped rectangles:

    benches/sides.py [--deaflow PROGRAM] [--patterns 6] [--rounds 5] [--only TEXT]

A device and its clamped rectangles have the same cells, elements, voltage, thickness and random patterns, and take
turns. A rectangle has the prestretch of the mount, or the mean stretches that the device has reached at rest, at least
1, below which nothing is mounted. All have one biquadratic element per cell; a tenth of the columns at each end is
bare. Processor times are those that deaflow writes (`solve_seconds`), for one thread. A device is released once for
all patterns: the time of a pattern is that of a batch less that of a single one, and the rest of the single one is the
release. Medians over rounds, Newton steps over patterns.

Conjugate-gradient iterations are in no output. Work is what `--time-limit` counts, these iterations and their
equivalents, with the proof of stability: the smallest limit at which a pattern converges. The release has the same
limit, so the work of a device is that of the pattern or of the release, whichever is larger; a bare pattern gives that
of the release.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import h5py
import numpy as np

LAW = "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }"
UNIT = 0.5e-3  # s of `--time-limit` for one conjugate-gradient iteration
SQUARE, STRIP, LONG = (50, 50), (72, 36), (110, 22)
FREE = "bottom: free, top: free"
WEIGHT = f"right: {{ bar: {{ load: [0.3 N, 0 N] }} }}, {FREE}"
TURNING = f"right: {{ bar: {{ load: [0.5 N, 0 N], at: 4 mm, spring: 20 N/m }} }}, {FREE}"

# Name, size in mm, prestretch, cells, sides, voltage in kV, goal of the ratios, rectangles.
CASES = [
    ("fresh at 1, bar of 2 N", (50, 25), (1, 1), STRIP,
     f"right: {{ bar: {{ load: [2 N, 0 N] }} }}, {FREE}", 12, 2, ["reached"]),
    ("fresh at 1, load of 2 N, two rollers", (50, 25), (1, 1), STRIP,
     "left: roller, bottom: roller, right: { load: [2 N, 0 N] }, top: free", 12, 2, ["reached"]),
    ("three free sides from 3, 1:1", (50, 50), (3, 3), SQUARE, f"right: free, {FREE}", 5.25, 4, ["mount", "reached"]),
    ("three free sides from 3, 2:1", (60, 30), (3, 3), STRIP, f"right: free, {FREE}", 5.25, 4, ["mount", "reached"]),
    ("three free sides from 3, 5:1", (100, 20), (3, 3), LONG, f"right: free, {FREE}", 5.25, 4, ["mount", "reached"]),
    ("two free sides from 3, 2:1", (60, 30), (3, 3), STRIP, FREE, 5.25, 4, ["mount", "reached"]),
    ("strip from 2, bar of 0.3 N", (40, 20), (2, 2), STRIP, WEIGHT, 4, 2, ["mount", "reached"]),
    ("turning bar, 0.5 N at 4 mm", (60, 20), (3, 1.5), STRIP, TURNING, 5.25, 2, ["mount", "reached"]),
    ("half on a roller at 3", (50, 25), (3, 3), STRIP, "bottom: roller", 5.25, 2, ["mount"]),
]


def scene(size, prestretch, cells, sides, voltage):
    sides = f", sides: {{ {sides} }}" if sides else ""
    size = ", ".join(f"{side:.6f} mm" for side in size)
    geometry = f"size: [{size}], thickness: 1 mm, prestretch: [{prestretch[0]:.6f}, {prestretch[1]:.6f}]"
    geometry = f"{geometry}, cells: [{cells[0]}, {cells[1]}]{sides}"
    return f"geometry: {{ {geometry} }}\n{LAW}\ndrive: {{ voltage: {voltage} kV }}\n"


class Device:
    def __init__(self, program, folder, name, text):
        self.program, self.folder, self.scene = program, folder, folder / f"{name}.yaml"
        self.scene.write_text(text)

    def solve(self, patterns, *options):
        """Whether all converge, their processor time, and the displacement at rest of the first."""
        out = self.folder / "out.h5"
        out.unlink(missing_ok=True)
        command = [self.program, "solve", self.scene, patterns, "-o", out, "--no-checks", "-j", "1", *options]
        done = subprocess.run([*command, "--order", "2", "--elements-per-cell", "1"], capture_output=True, text=True)
        if done.returncode != 0 and not out.exists():
            sys.exit(f"{self.scene.read_text()}\n{done.stderr}{done.stdout}")
        with h5py.File(out) as found:
            outcomes = found["outcome"].asstr()[()]
            self.outcome = next((outcome for outcome in outcomes if outcome != "converged"), "converged")
            rest = found["rest"][0] if "rest" in found else None
            return self.outcome == "converged", found["solve_seconds"][()].sum(), rest

    def work(self, patterns):
        """The smallest limit, in iterations to 2 %, at which all patterns converge."""
        low, high = 2, 32
        while not self.solve(patterns, "--time-limit", f"{UNIT * high:.6f} s")[0]:
            low, high = high, 2 * high
        while high > low + 1 and high > 1.02 * low:
            middle = (low + high) // 2
            converged, *_ = self.solve(patterns, "--time-limit", f"{UNIT * middle:.6f} s")
            low, high = (low, middle) if converged else (middle, high)
        return high

    def steps(self, patterns):
        """Newton steps of each pattern."""
        pipeline = self.folder / f"{self.scene.stem}-steps.yaml"
        drawn = f"drawn: {{ kind: patterns, files: [{patterns.name}] }}"
        solved = "solved: { kind: solve, needs: [drawn], order: 2, elements_per_cell: 1 }"
        head = f"version: 1\nname: {pipeline.stem}\nscene: {self.scene.name}\nstages:"
        pipeline.write_text(f"{head}\n  {drawn}\n  {solved}\n")

        def said(*command):
            done = subprocess.run([self.program, *command], cwd=self.folder, check=True, capture_output=True, text=True)
            return done.stdout

        said("run", pipeline, "-j", "1")
        rows = [line.split(",") for line in said("show", f"{pipeline}:solved", "--csv").splitlines()]
        return [int(row[rows[0].index("newton_iterations")]) for row in rows[1:]]


def reached(size, prestretch, rest):
    """The size and the stretches of the rectangle that has the mean stretches at rest."""
    growth = [np.mean(rest[:, -1, 0] - rest[:, 0, 0]), np.mean(rest[-1, :, 1] - rest[0, :, 1])]
    stretches = [max(1.0, stretch * (1 + more / side)) for stretch, more, side in zip(prestretch, growth, size)]
    return [side / mounted * stretch for side, mounted, stretch in zip(size, prestretch, stretches)], stretches


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--deaflow", default="deaflow", help="the program")
    parser.add_argument("--patterns", type=int, default=6, help="random patterns of each device, beside a single one")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="", help="only devices whose name has this text")
    options = parser.parse_args()
    columns = ["device", "rectangle", "Newton steps", "ratio", "ms", "ratio", "work", "ratio", "release: ms", "work"]
    print(f"| {' | '.join(columns)} | goal |\n|---|---|" + "---:|" * 8 + "---|")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["DEAFLOW_STORE"] = str(Path(folder) / "store")
        for number, case in enumerate(CASES):
            if options.only in case[0]:
                compare(options, Path(folder), number, *case)


def compare(options, folder, number, name, size, prestretch, cells, sides, voltage, goal, rectangles):
    """Prints a line for each rectangle."""
    random = np.random.default_rng(number)
    drawn = (random.random((options.patterns + 1, cells[1], cells[0])) < 0.5).astype(np.uint8)
    margin = cells[0] // 10
    drawn[:, :, :margin] = drawn[:, :, -margin:] = 0
    single, many, bare = (folder / f"{number}-{which}.npy" for which in ("single", "many", "bare"))
    np.save(single, drawn[:1])
    np.save(many, drawn)
    np.save(bare, np.zeros_like(drawn[:1]))
    device = Device(options.deaflow, folder, f"{number}-device", scene(size, prestretch, cells, sides, voltage))
    converged, _, rest = device.solve(many)
    if not converged:
        print(f"| {name} | | {device.outcome} |", flush=True)
        return
    devices, stretches = [device], [prestretch]
    for which in rectangles:
        mounted, stretch = (size, prestretch) if which == "mount" else reached(size, prestretch, rest)
        clamped = Device(options.deaflow, folder, f"{number}-{which}", scene(mounted, stretch, cells, "", voltage))
        if clamped.solve(many)[0]:
            devices.append(clamped)
            stretches.append(f"{which}: {stretch[0]:.2f}, {stretch[1]:.2f}")
        else:
            print(f"| {name} | {which}: {stretch[0]:.2f}, {stretch[1]:.2f} | {clamped.outcome} |", flush=True)
    # All have run once: now they take turns.
    rounds = [[[d.solve(patterns)[1] for patterns in (single, many)] for d in devices] for _ in range(options.rounds)]
    ms = [1e3 * median((r[at][1] - r[at][0]) / options.patterns for r in rounds) for at in range(len(devices))]
    release = 1e3 * median(r[0][0] for r in rounds) - ms[0] if rest is not None else 0.0
    steps = [median(d.steps(many)) for d in devices]
    work = [d.work(single) for d in devices]
    released = device.work(bare) if rest is not None else 0
    at_most = "≤ " if work[0] <= released else ""
    for at in range(1, len(devices)):
        ratios = [numbers[0] / numbers[at] for numbers in (steps, ms, work)]
        met = "met" if max(ratios[:2]) <= goal else "missed"
        numbers = [
            f"{steps[0]:g} / {steps[at]:g}", f"{ratios[0]:.2f}",
            f"{ms[0]:.1f} / {ms[at]:.1f}", f"{ratios[1]:.2f}",
            f"{at_most}{work[0]} / {work[at]}", f"{at_most}{ratios[2]:.2f}",
            f"{release:.0f}", f"{released}", f"{goal}: {met}",
        ]
        print(f"| {name} | {stretches[at]} | {' | '.join(numbers)} |", flush=True)


if __name__ == "__main__":
    main()
