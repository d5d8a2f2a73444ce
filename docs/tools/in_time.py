"""What the screening of viscoelasticity predicts, beside what histories say: the table of docs/effects.md.

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
# The sum that is screened is 4G/(mu lambda_p^2) at a branch's whole share.
STIFFNESS = 45e3 * 9


def displacement(folder, modulus, more, *at):
    """[pattern][time][y][x][component] of half of the membrane and of random blocks; an equilibrium where no time is asked for."""
    (folder / "scene.yaml").write_text(
        f"geometry: {{ side: 50 mm, thickness: 1 mm, prestretch: 3, cells: {CELLS} }}\n"
        "material: { model: neo-hookean, shear_modulus: 45 kPa, relative_permittivity: 4.7 }\n"
        f"drive: {{ voltage: 5250 V{more} }}\n"
        f"effects: {{ viscoelasticity: {{ branches: [{{ modulus: {modulus} Pa, time: 1 s }}] }} }}\n"
    )
    history = ["--history", "--at", *at] if at else []
    command = [DEAFLOW, "solve", "scene.yaml", "half.csv", "blocks.csv", "-o", "out.h5", *history]
    subprocess.run(command, cwd=folder, capture_output=True, check=True)
    with h5py.File(folder / "out.h5") as file:
        return file["displacement"][:, 0] if at else file["displacement"][:]


def change(a, b):
    """max |a - b| / max |b| of each pattern."""
    size = lambda field: np.sqrt((field**2).sum(axis=-1)).max(axis=(-1, -2))
    return size(a - b) / size(b)


with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    half = np.tile(np.arange(CELLS) < CELLS // 2, (CELLS, 1))
    blocks = np.kron(np.random.default_rng(3).random((5, 5)) < 0.5, np.ones((4, 4)))
    for label, pattern in (("half", half), ("blocks", blocks)):
        np.savetxt(folder / f"{label}.csv", np.asarray(pattern, int), fmt="%d", delimiter=",")
    print("| what | predicted | half | blocks |\n|---|---|---|---|")
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
