#!/usr/bin/env python3
"""Counts how often the measured cost of a stage is within the range that `deaflow plan` printed.

    python3 docs/tools/prices.py target/release/deaflow [--repeat N] [--csv FILE]

It runs a small pipeline in its own store, then makes one change after another, and compares each time the estimates of `plan` with the
seconds of `run`, of stages that ran in parallel with their share. The store then has the costs of earlier changes, as usual. It takes some minutes and needs only Python. Times depend on other work of the
machine: the last line has the load before and after."""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile

PIPELINE = """version: 1
name: prices
scene:
  geometry: { side: 50 mm, thickness: 1.0 mm, prestretch: 3.0, cells: 50 }
  material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }
  drive: { voltage: 5.25 kV }
  effects: {}
stages:
  small:     { kind: sample, family: small-grid, count: 200, seed: 1 }
  bezier:    { kind: sample, family: bezier, count: 100, seed: 3 }
  solved:    { kind: solve, needs: [small, bezier], elements_per_cell: 2 }
  balanced:  { kind: balance, needs: [solved], bins: 50, range: [0 mm, 2.5 mm], target: 200, symmetry: d4, seed: 4 }
  surrogate: { kind: train, needs: [balanced], network: physics, epochs: 2, seed: 5 }
  audited:   { kind: audit, needs: [balanced], samples: 8, seed: 1, fail_on: never }
  mine:      { kind: import, files: [few.csv] }
  checked:   { kind: audit, needs: [mine], samples: 8, seed: 1, fail_on: never }
  design:    { kind: design, needs: [surrogate], evaluator: surrogate, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, population: 100, generations: 10, seed: 6 }
  optimum:   { kind: design, method: adjoint, objective: { point: [25 mm, 25 mm], direction: 0 deg }, area: 0.5, units: 20, starts: 2, seed: 7 }
  verified:  { kind: verify, needs: [design, optimum], elements_per_cell: 2 }
"""

# Typical changes, made one after another.
CHANGES = [
    ["small.seed=2"],
    ["small.count=400"],
    ["small.count=800"],
    ["small.count=100"],
    ["bezier.count=200"],
    ["solved.elements_per_cell=1"],
    ["solved.elements_per_cell=3"],
    ["solved.order=2"],
    ["solved.tolerance=1e-6"],
    ["scene.drive.voltage=5 kV"],
    ["scene.drive.voltage=4 kV"],
    ["scene.geometry.prestretch=2.8"],
    ["balanced.target=400"],
    ["balanced.target=100"],
    ["balanced.bins=20"],
    ["surrogate.epochs=4"],
    ["surrogate.epochs=6"],
    ["surrogate.batch=16"],
    ["surrogate.learning_rate=0.005"],
    ["surrogate.seed=9"],
    ["design.generations=20"],
    ["design.generations=40"],
    ["design.population=200"],
    ["design.population=400"],
    ["design.area=0.4", "optimum.area=0.4"],
    ["design.seed=8"],
    ["audited.samples=16"],
    ["audited.samples=2"],
    ["mine.files=[many.csv]"],
    ["mine.files=[more.csv]"],
    ["mine.files=[few.csv, many.csv]"],
    ["mine.files=[three.csv]"],
    ["checked.samples=32"],
    ["design.mutation=0.2"],
    ["optimum.starts=4"],
    ["optimum.units=50"],
    ["optimum.seed=9"],
    ["verified.elements_per_cell=3"],
    ["verified.elements_per_cell=4", "verified.order=2"],
    ["small.count=600", "surrogate.epochs=3"],
    ["solved.elements_per_cell=1", "design.population=300"],
    # Without earlier costs: the plan must not print a number.
    ["surrogate.network=qin2024", "surrogate.epochs=1"],
    ["design.evaluator=linear"],
]


def settings(change):
    for each in change:
        yield "--set"
        yield each if each.startswith("scene.") else "stages." + each


def stages(program, command, file, store, change):
    done = subprocess.run(
        [program, command, file, "--store", store, "--json", *settings(change)],
        capture_output=True,
        text=True,
    )
    if done.returncode not in (0, 3):
        sys.exit(f"{command} {change}: exit code {done.returncode}: {done.stderr}")
    return {stage["name"]: stage for stage in json.loads(done.stdout)["stages"]}


def write_labels(program, folder):
    """Writes files with labels of 3 to 300 patterns, for imports."""
    scene = PIPELINE.split("scene:\n")[1].split("stages:\n")[0]
    with open(os.path.join(folder, "scene.yaml"), "w", encoding="utf-8") as file:
        file.write("\n".join(line[2:] for line in scene.splitlines()))
    for name, count in [("three", 3), ("few", 10), ("many", 100), ("more", 300)]:
        cells = bytes((i % 2500 // 50 * 7 + i % 50 + 3 * (i // 2500)) % (40 + i // 2500 % 11) < 20 for i in range(count * 2500))
        header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({count}, 50, 50), }}\n".encode()
        with open(os.path.join(folder, f"{name}.npy"), "wb") as file:
            file.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header + cells)
        command = [program, "solve", "scene.yaml", f"{name}.npy", "-o", f"{name}.h5"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        if done.returncode not in (0, 3):
            sys.exit(f"solve {name}: exit code {done.returncode}: {done.stderr}")
        # A table does not name its scene, so that it can be imported into others.
        with open(os.path.join(folder, f"{name}.csv"), "w", encoding="utf-8") as file:
            subprocess.run([program, "show", f"{name}.h5", "--corners"], cwd=folder, stdout=file, check=True)


def measure(program, repeat):
    """Returns one row per stage built after a change."""
    rows = []
    for number in range(repeat):
        with tempfile.TemporaryDirectory() as folder:
            file, store = os.path.join(folder, "prices.yaml"), os.path.join(folder, "store")
            with open(file, "w", encoding="utf-8") as pipeline:
                pipeline.write(PIPELINE)
            write_labels(program, folder)
            stages(program, "run", file, store, [])
            for change in CHANGES:
                planned = stages(program, "plan", file, store, change)
                ran = stages(program, "run", file, store, change)
                for name, stage in ran.items():
                    if stage["outcome"] != "built":
                        continue
                    price = (planned[name]["price"] or {}).get("seconds")
                    rows.append({
                        "repetition": number,
                        "change": " ".join(change),
                        "stage": name,
                        "kind": stage["kind"],
                        "low": price and price["low"],
                        "likely": price and price["likely"],
                        "high": price and price["high"],
                        # Stages that ran in parallel share the time; a price estimates the share.
                        "took": stage.get("part", stage["seconds"]),
                        "unmeasured": planned[name].get("unmeasured") or "",
                    })
    return rows


def holds(row):
    return row["low"] <= row["took"] <= row["high"]


def summary(title, rows):
    priced = [row for row in rows if row["low"] is not None]
    if not priced:
        return f"{title:12} {len(rows):5} stages, none with a price"
    held = sum(holds(row) for row in priced)
    ratios = sorted(row["took"] / max(row["likely"], 1e-9) for row in priced)
    widths = sorted(row["high"] / max(row["low"], 1e-3) for row in priced)
    middle = len(priced) // 2
    below = sum(row["took"] < row["low"] for row in priced)
    return (
        f"{title:12} {len(priced):5} priced  {100 * held / len(priced):5.1f} % held  {below} took less, "
        f"{len(priced) - held - below} more  took/likely {ratios[middle]:.2f} (from {ratios[0]:.2f} to {ratios[-1]:.2f})  "
        f"high/low {widths[middle]:.1f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--csv")
    arguments = parser.parse_args()
    before = os.getloadavg()[0]
    rows = measure(os.path.abspath(arguments.program), arguments.repeat)
    if arguments.csv:
        with open(arguments.csv, "w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(rows)
    for kind in sorted({row["kind"] for row in rows}):
        print(summary(kind, [row for row in rows if row["kind"] == kind]))
    print(summary("all", rows))
    unpriced = sorted({row["unmeasured"] for row in rows if row["low"] is None})
    print("without a price:", "; ".join(unpriced) or "none")
    print(f"load of the machine {before:.1f} before, {os.getloadavg()[0]:.1f} after; {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
