"""Compares the screening of effects in time with histories and responses: the numbers in docs/effects.md.

    python3 docs/tools/in_time.py [DEAFLOW]

Needs numpy and h5py. Takes a minute."""
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

DEAFLOW = sys.argv[1] if len(sys.argv) > 1 else "deaflow"
CELLS = 20
# The screening number of a fully active branch is 4G/(mu lambda_p^2).
STIFFNESS = 45e3 * 9


PERMITTIVITY = 4.7 * 8.8541878128e-12
DENSITY, SHEET = 960, 1e6


def solve(folder, drive, effects, patterns, *options, more=""):
    """Solves patterns and opens the file of the solution."""
    (folder / "scene.yaml").write_text(
        f"geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {CELLS} }}\n"
        "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n"
        f"drive: {{ {drive} }}\neffects: {{ {effects} }}\n{more}"
    )
    command = [DEAFLOW, "solve", "scene.yaml", *(f"{name}.csv" for name in patterns), "-o", "out.h5", *options]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    return h5py.File(folder / "out.h5")


def displacement(folder, modulus, more, *at):
    """Returns [pattern][time][y][x][component] for half of the membrane and for random blocks; the equilibrium if no time is given."""
    effects = f"viscoelasticity: {{ branches: [{{ modulus: {modulus} Pa, time: 1 s }}] }}"
    history = ["--history", "--at", *at] if at else []
    with solve(folder, f"voltage: 5250 V{more}", effects, ["half", "blocks"], *history) as file:
        return file["displacement"][:, 0] if at else file["displacement"][:]


def amplitudes(folder, frequency, effects):
    """Returns the amplitude per volt over all corners of each pattern."""
    asked = ["--response", f"{frequency} Hz:{1.001 * frequency} Hz", "--points", "2"]
    with solve(folder, "voltage: 5250 V", effects, ["half", "blocks"], *asked) as file:
        return np.hypot(file["response_real"][:, 0], file["response_imaginary"][:, 0])


def swings(folder, frequency, effects):
    """Returns [pattern][time][y][x][component] over the second period of a voltage of 4 kV ± 0.5 kV at a frequency, from the left side."""
    at = ", ".join(f"{(1 + k / 8) / frequency} s" for k in range(8))
    drive = f"voltage: 500 V, waveform: {{ sine: {{ frequency: {frequency} Hz, bias: 4 kV }} }}"
    asked = ["--history", "--at", at]
    with solve(folder, drive, effects, ["stripe", "comb"], *asked, more="leads: [left]\n") as file:
        return file["displacement"][:]


def change(a, b):
    """Returns max |a - b| / max |b| of each pattern."""
    size = lambda field: np.sqrt((field**2).sum(axis=-1)).max(axis=(-1, -2))
    return size(a - b) / size(b)


with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    half = np.tile(np.arange(CELLS) < CELLS // 2, (CELLS, 1))
    blocks = np.kron(np.random.default_rng(3).random((5, 5)) < 0.5, np.ones((4, 4)))
    # Electrodes as long as the membrane, from the lead on.
    stripe = half.T
    comb = np.tile(np.arange(CELLS)[:, None] % 4 < 2, (1, CELLS)) | (np.arange(CELLS) < 2)
    for label, pattern in (("half", half), ("blocks", blocks), ("stripe", stripe), ("comb", comb)):
        np.savetxt(folder / f"{label}.csv", np.asarray(pattern, int), fmt="%d", delimiter=",")
    print("| viscoelasticity | predicted | half | blocks |\n|---|---|---|---|")
    row = lambda what, predicted, found: print(f"| {what} | {predicted:.3f} | {found[0]:.3f} | {found[1]:.3f} |")
    for weight in (0.005, 0.02, 0.1, 0.4):
        modulus = weight * STIFFNESS / 4
        row("at once", weight, change(displacement(folder, modulus, "", "0 s"), displacement(folder, modulus, "")))
    for weight, time in ((0.1, 2), (0.4, 1), (0.4, 3)):
        modulus = weight * STIFFNESS / 4
        found = change(displacement(folder, modulus, "", f"{time} s"), displacement(folder, modulus, ""))
        row(f"after {time} τ", weight * np.exp(-time / (1 + weight)), found)
    for ratio, rest in ((0.1, 0), (0.1, 2), (0.5, 1)):
        modulus = 45e3 * ratio
        found = change(displacement(folder, modulus, f", rest: {rest} s", "0 s"), displacement(folder, modulus, "", "0 s"))
        row(f"rest of {rest} τ", ratio * np.exp(-rest), found)

    print("\n| inertia: f/f₁ | predicted | half | blocks |\n|---|---|---|---|")
    first = np.hypot(3 / 0.1, 3 / 0.1) * np.sqrt(45e3 / DENSITY)
    for ratio in (0.05, 0.1, 0.2, 0.4):
        frequency = ratio * first
        moving = amplitudes(folder, frequency, f"inertia: {{ density: {DENSITY} kg/m3 }}")
        found = change(moving, amplitudes(folder, 1e-3 * first, f"inertia: {{ density: {DENSITY} kg/m3 }}"))
        row(ratio, ratio**2 / (1 - ratio**2), found)

    print("\n| electrode resistance: 2πf R c/Λ₁ | stripe | comb |\n|---|---|---|")
    # Both sheets, over the lowest eigenvalue of an electrode as long as the membrane.
    time = 2 * SHEET * PERMITTIVITY / (1e-3 / 9) / (0.5 * np.pi / 50e-3) ** 2
    for number in (0.01, 0.04, 0.1, 0.4):
        frequency = number / (2 * np.pi * time)
        charging, charged = (
            swings(folder, frequency, effects) for effects in (f"electrode_resistance: {{ sheet_resistance: {SHEET} Ohm }}", "")
        )
        swing = charged - charged.mean(axis=1, keepdims=True)
        size = lambda field: np.sqrt((field**2).sum(axis=-1)).max(axis=(1, 2, 3))
        found = size(charging - charged) / size(swing)
        print(f"| {number} | {found[0]:.3f} | {found[1]:.3f} |")
