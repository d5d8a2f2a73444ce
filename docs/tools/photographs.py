"""Puts photographs of the page of `deaflow serve` where the documentation shows them.

    DEAFLOW_ALBUM=/tmp/album cargo test --locked --test it serve
    python3 docs/tools/photographs.py /tmp/album

The tests take them in Chromium, light and dark, at two widths, into a folder that is there. Those that are shown are reduced to a few colours,
which takes a fifth of the bytes: they are fetched with every clone.
"""

import collections
import pathlib
import struct
import sys
import zlib

# Of each figure of the documentation the photograph.
FIGURES = {
    "sketchpad": "sketchpad-1440-light",
    "serve-pipeline": "pipeline-1440-light",
    "serve-rows": "rows-1440-light",
}

COLOURS = 48


def predicted(kind, left, above, corner):
    """What a byte is told the difference to (PNG, section 9)."""
    if kind < 3:
        return (0, left, above)[kind]
    if kind == 3:
        return (left + above) // 2
    guess = left + above - corner
    near = [abs(guess - value) for value in (left, above, corner)]
    return (left, above, corner)[near.index(min(near))]


def pixels(path):
    """Width, height, and rows of red, green and blue of a PNG as Chromium writes it."""
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
    """The square of the distance of two colours."""
    return sum((a - b) ** 2 for a, b in zip(one, other))


def chosen(counts):
    """Colours that leave none far from all of them that has many pixels: each is the one that those before serve worst."""
    palette = [counts.most_common(1)[0][0]]
    missed = {pixel: apart(pixel, palette[0]) for pixel in counts}
    while len(palette) < COLOURS and any(missed.values()):
        palette.append(max(missed, key=lambda pixel: missed[pixel] * counts[pixel] ** 0.5))
        missed = {pixel: min(worst, apart(pixel, palette[-1])) for pixel, worst in missed.items()}
    return palette


def write(path, width, height, rows):
    """Writes a PNG of a few colours, of which each other one takes the nearest."""
    counts = collections.Counter(pixel for row in rows for pixel in row)
    palette = chosen(counts)
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
    docs = pathlib.Path(__file__).resolve().parent.parent / "figures"
    for name, photograph in FIGURES.items():
        path = pathlib.Path(folders[0]) / f"{photograph}.png"
        if not path.is_file():
            sys.exit(f"there is no {path}")
        write(docs / f"{name}.png", *pixels(path))
        print(f"docs/figures/{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
