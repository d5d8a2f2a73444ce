"""Copies photographs of the page of `deaflow serve` to the documentation.

    DEAFLOW_ALBUM=/tmp/album cargo test --locked --test it serve
    python3 docs/tools/photographs.py /tmp/album

The tests take the photographs in Chromium, light and dark, at two widths, and write them to an existing folder. Sheets combine several views, each in a row, at a third of
their size. All are reduced to a few colours, a fifth of the bytes, because every clone fetches them.
"""

import collections
import pathlib
import struct
import sys
import zlib

# The photograph of each figure.
FIGURES = {
    "sketchpad": "sketchpad-1440-light",
}

# The views of each sheet, from top to bottom.
SHEETS = {
    "serve-runs": ["pipeline", "running", "runs", "compare"],
    "serve-data": ["artifacts", "rows", "sample", "audit"],
    "serve-results": ["model", "designs", "accuracy", "sketchpad"],
}

# Screen width and colour scheme of the photographs.
SCREENS = ["1440-light", "1440-dark", "390-light", "390-dark"]

# Scale of a sheet: this many pixels along each side become one.
SHRUNK = 3

# Gap between the photographs of a sheet, and its colour.
GAP, BACKGROUND = 8, (255, 255, 255)

COLOURS = 48
SHEET_COLOURS = 24


def predicted(kind, left, above, corner):
    """Returns the predicted value of a byte (PNG filters, section 9)."""
    if kind < 3:
        return (0, left, above)[kind]
    if kind == 3:
        return (left + above) // 2
    guess = left + above - corner
    near = [abs(guess - value) for value in (left, above, corner)]
    return (left, above, corner)[near.index(min(near))]


def pixels(path):
    """Reads width, height, and rows of red, green and blue of a PNG from Chromium."""
    data, at, packed = path.read_bytes(), 8, b""
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        chunk = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height, _, colour = struct.unpack(">IIBB", chunk[:10])
        if kind == b"IDAT":
            packed += chunk
        at += 12 + length
    channels = {2: 3, 6: 4}[colour]
    raw, size, before, rows = zlib.decompress(packed), width * channels, None, []
    for row in range(height):
        start = row * (size + 1)
        kind, line = raw[start], bytearray(raw[start + 1 : start + 1 + size])
        before = before or bytearray(size)
        for k in range(size if kind else 0):
            left, corner = (line[k - channels], before[k - channels]) if k >= channels else (0, 0)
            line[k] = (line[k] + predicted(kind, left, before[k], corner)) & 255
        rows.append([tuple(line[k : k + 3]) for k in range(0, size, channels)])
        before = line
    return width, height, rows


def apart(one, other):
    """Returns the squared distance of two colours."""
    return sum((a - b) ** 2 for a, b in zip(one, other))


def chosen(counts, most):
    """Chooses a palette: each new colour is the one that the previous ones represent worst, weighted by its pixels."""
    palette = [counts.most_common(1)[0][0]]
    missed = {pixel: apart(pixel, palette[0]) for pixel in counts}
    while len(palette) < most and any(missed.values()):
        palette.append(max(missed, key=lambda pixel: missed[pixel] * counts[pixel] ** 0.5))
        missed = {pixel: min(worst, apart(pixel, palette[-1])) for pixel, worst in missed.items()}
    return palette


def shrunk(width, height, rows):
    """Averages blocks of pixels and rounds the result to an eighth of the levels, so that texts have fewer colours."""
    small = []
    for y in range(0, height - SHRUNK + 1, SHRUNK):
        parts = [rows[y + k] for k in range(SHRUNK)]
        line = []
        for x in range(0, width - SHRUNK + 1, SHRUNK):
            block = [pixel for part in parts for pixel in part[x : x + SHRUNK]]
            line.append(tuple(min(255, (sum(channel) // len(block) + 4) & ~7) for channel in zip(*block)))
        small.append(line)
    return small


def sheet(album, views):
    """Returns width, height and rows of a sheet."""
    rows = []
    for view in views:
        photographs = [shrunk(*pixels(album / f"{view}-{screen}.png")) for screen in SCREENS]
        for y in range(max(len(photograph) for photograph in photographs)):
            line = []
            for photograph in photographs:
                line += (photograph[y] if y < len(photograph) else [BACKGROUND] * len(photograph[0])) + [BACKGROUND] * GAP
            rows.append(line[:-GAP])
        rows += [[BACKGROUND] * len(rows[-1])] * GAP
    return len(rows[0]), len(rows) - GAP, rows[:-GAP]


def reduce(path):
    """Rewrites a drawing with fewer colours."""
    if path.read_bytes()[25] in (2, 6):
        write(path, *pixels(path))


def write(path, width, height, rows, colours=COLOURS):
    """Writes a PNG with a palette; each pixel gets the nearest colour."""
    counts = collections.Counter(pixel for row in rows for pixel in row)
    palette = chosen(counts, colours)
    place = {pixel: min(range(len(palette)), key=lambda k: apart(palette[k], pixel)) for pixel in counts}
    lines = b"".join(b"\0" + bytes(place[pixel] for pixel in row) for row in rows)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0))
    colours = chunk(b"PLTE", b"".join(bytes(pixel) for pixel in palette))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + header + colours + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b""))


def main(folders):
    if len(folders) != 1:
        sys.exit("name the folder of the photographs")
    docs, album = pathlib.Path(__file__).resolve().parent.parent / "figures", pathlib.Path(folders[0])
    of_sheets = [f"{view}-{screen}" for views in SHEETS.values() for view in views for screen in SCREENS]
    for photograph in [*FIGURES.values(), *of_sheets]:
        if not (album / f"{photograph}.png").is_file():
            sys.exit(f"there is no {album / photograph}.png")
    for name, photograph in FIGURES.items():
        write(docs / f"{name}.png", *pixels(album / f"{photograph}.png"))
        print(f"docs/figures/{name}.png")
    for name, views in SHEETS.items():
        write(docs / f"{name}.png", *sheet(album, views), SHEET_COLOURS)
        print(f"docs/figures/{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
