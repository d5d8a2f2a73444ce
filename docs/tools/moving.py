"""Draws docs/figures/moving.svg: two electrode patterns of equal area, and the membranes that move as the voltage rises.

    deaflow run pipelines/quickstart.yaml && deaflow report pipelines/quickstart.yaml -o report
    python3 docs/tools/moving.py target/release/deaflow report

The patterns are the intuitive design and the refined design of the report. Displacements are drawn twice as large.
"""

import pathlib
import subprocess
import sys
import tempfile

import h5py
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
SCENE = ROOT / "pipelines" / "scenes" / "vhb4910-stiffening.yaml"
POINT = (37.5, 37.5)
VOLTS, FRAMES, SCALE, SIDE = 5250, 13, 2.0, 50
# Frames whose outlines are drawn; between them, points move along lines.
DRAWN = [0, 5, 8, 10, 12]
PIXELS = 6.4  # per mm
LABELS = ["as intuition suggests", "as deaflow designs it"]


def displacements(program, patterns):
    """Returns displacements in mm, `[frame][pattern][corner_y][corner_x][xy]`."""
    frames = []
    with tempfile.TemporaryDirectory() as folder:
        for frame in range(FRAMES):
            volts = VOLTS * frame / (FRAMES - 1)
            if frame == 0:
                frames.append(None)
                continue
            path = pathlib.Path(folder) / f"{frame}.h5"
            drive = f"drive.voltage={volts} V"
            subprocess.run(
                [program, "solve", SCENE, *patterns, "-o", path, "--elements-per-cell", "2", "--set", drive],
                check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )
            with h5py.File(path) as file:
                frames.append(file["displacement"][:])
    frames[0] = np.zeros_like(frames[1])
    return np.array(frames)


def loops(cells):
    """Returns the outlines of the cells with electrodes as loops of corners (x, y)."""
    ahead = {}
    rows, columns = cells.shape
    is_on = lambda x, y: 0 <= x < columns and 0 <= y < rows and cells[y, x]
    for y in range(rows):
        for x in range(columns):
            if not cells[y, x]:
                continue
            for start, end, other in [
                ((x, y), (x + 1, y), (x, y - 1)),
                ((x + 1, y), (x + 1, y + 1), (x + 1, y)),
                ((x + 1, y + 1), (x, y + 1), (x, y + 1)),
                ((x, y + 1), (x, y), (x - 1, y)),
            ]:
                if not is_on(*other):
                    ahead.setdefault(start, []).append(end)
    found = []
    while ahead:
        start = next(iter(ahead))
        loop, at = [], start
        while True:
            ends = ahead[at]
            then = ends.pop()
            if not ends:
                del ahead[at]
            loop.append(at)
            at = then
            if at == start:
                break
        found.append(loop)
    return found


def path(lines, field, closed):
    """Returns lines through corners, moved by a field, as the data of an SVG path."""
    parts = []
    for line in lines:
        x, y = np.array(line).T
        places = np.stack([x, y], axis=1) + SCALE * field[y, x]
        # In halves of a pixel, each from the one before: half as many bytes.
        pixels = np.rint(2 * PIXELS * np.stack([places[:, 0], SIDE - places[:, 1]], axis=1)).astype(int)
        steps = "l".join(f"{a} {b}" for a, b in np.diff(pixels, axis=0))
        parts.append(f"M{pixels[0][0]} {pixels[0][1]}l{steps}" + ("z" if closed else ""))
    return "".join(parts)


def animated(values, times):
    return ";".join(values), ";".join(f"{time:.3f}" for time in times)


def main(program, report):
    folder = pathlib.Path(report) / "data" / "patterns"
    files = [folder / "design-intuitive-equal-area.csv", folder / "design-refined.csv"]
    cells = [np.loadtxt(file, delimiter=",", comments="#", dtype=int) for file in files]
    fields = displacements(program, files)
    # Rises for half of the time, stays, and falls.
    def schedule(frames):
        return frames + [FRAMES - 1, 0], [0.5 * frame / (FRAMES - 1) for frame in frames] + [0.85, 1.0]

    order, times = schedule(list(range(FRAMES)))
    drawn, times_drawn = schedule(DRAWN)
    side = PIXELS * SIDE
    width, height, gap = 2 * side + 60, side + 92, 40
    out = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" width="{width:.0f}" height="{height:.0f}" '
        'font-family="system-ui, sans-serif">',
        "<title>Two membranes with electrodes of equal area on one half, as the voltage rises to 5.25 kV</title>",
        f'<rect width="{width:.0f}" height="{height:.0f}" fill="#fff"/>',
    ]
    mesh = [[(x, y) for y in range(SIDE + 1)] for x in range(0, SIDE + 1, 5)]
    mesh += [[(x, y) for x in range(SIDE + 1)] for y in range(0, SIDE + 1, 5)]
    mesh = [line[::2] for line in mesh]
    for panel, label in enumerate(LABELS):
        outline = loops(cells[panel])
        of_frames = [fields[frame][panel] for frame in range(FRAMES)]
        out.append(f'<g transform="translate({10 + panel * (side + gap):.0f} 34)">')
        out.append(f'<text x="0" y="-12" font-size="17" fill="#1b1f24">{label}</text>')
        for lines, closed, style in [
            (outline, True, 'fill="#56b4e9" fill-rule="evenodd"'),
            (mesh, False, 'fill="none" stroke="#1b1f24" stroke-opacity=".28" stroke-width="1.6"'),
        ]:
            values, keys = animated([path(lines, of_frames[frame], closed) for frame in drawn], times_drawn)
            out.append(
                f'<path transform="scale(.5)" {style} d="{path(lines, of_frames[-1], closed)}"><animate attributeName="d" dur="5s" repeatCount="indefinite" '
                f'keyTimes="{keys}" values="{values}"/></path>'
            )
        out.append(f'<rect width="{side:.0f}" height="{side:.0f}" fill="none" stroke="#59636e" stroke-width="2"/>')
        # The point is the centre of a cell.
        x, y = (int(coordinate) for coordinate in POINT)
        motion = [field[y : y + 2, x : x + 2].mean(axis=(0, 1)) for field in of_frames]
        at = [(PIXELS * (POINT[0] + SCALE * u[0]), PIXELS * (SIDE - POINT[1] - SCALE * u[1])) for u in motion]
        rest = at[0]
        out.append(f'<circle cx="{rest[0]:.1f}" cy="{rest[1]:.1f}" r="5" fill="none" stroke="#d55e00" stroke-width="1.5"/>')
        keys = ";".join(f"{time:.3f}" for time in times)
        animations = "".join(
            f'<animate attributeName="{name}" dur="5s" repeatCount="indefinite" keyTimes="{keys}" '
            f'values="{";".join(f"{at[frame][index]:.1f}" for frame in order)}"/>'
            for name, index in [("cx", 0), ("cy", 1)]
        )
        out.append(f'<circle cx="{at[-1][0]:.1f}" cy="{at[-1][1]:.1f}" r="5" fill="#d55e00">{animations}</circle>')
        along = [float(u @ np.array([1.0, 1.0]) / np.sqrt(2.0)) for u in motion]
        for frame in range(FRAMES):
            shown = ";".join("visible" if other == frame else "hidden" for other in order)
            is_last = "visible" if frame == FRAMES - 1 else "hidden"
            volts = VOLTS * frame / (FRAMES - 1) / 1000
            out.append(
                f'<text x="0" y="{side + 32:.0f}" font-size="22" fill="#1b1f24" visibility="{is_last}">{along[frame]:.2f} mm outwards at {volts:.2f} kV'
                f'<animate attributeName="visibility" calcMode="discrete" dur="5s" repeatCount="indefinite" keyTimes="{keys}" values="{shown}"/></text>'
            )
        out.append("</g>")
    out.append("</svg>")
    target = ROOT / "docs" / "figures" / "moving.svg"
    target.write_text("\n".join(out) + "\n")
    print(f"{target}: {target.stat().st_size} bytes")


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
