"""Reads exported designs as strangers would, and prints what they hold as JSON: python export.py FILE...

With ezdxf, gerbonara and pyvista where they are installed; else with a few lines of our own, and `reader` says so.
Areas are those that a drawing program fills, in the unit that the file states.
"""

import json
import struct
import sys
import xml.etree.ElementTree as ElementTree
import zlib


def shoelace(ring):
    return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(ring, ring[1:] + ring[:1]))


def svg(path):
    namespace = "{http://www.w3.org/2000/svg}"
    root = ElementTree.parse(path).getroot()
    electrode = root.find(f"{namespace}path")
    frame = root.find(f"{namespace}rect")
    rings = []
    for part in electrode.get("d").split("M")[1:]:
        words = part.replace("L", " ").replace("Z", " ").split()
        rings.append([tuple(float(v) for v in word.split(",")) for word in words])
    areas = [-shoelace(ring) for ring in rings]  # y points downwards
    return {
        "reader": "xml.etree",
        "title": root.find(f"{namespace}title").text,
        "notes": root.find(f"{namespace}desc").text,
        "size": [root.get("width"), root.get("height"), root.get("viewBox")],
        "rule": electrode.get("fill-rule"),
        "frame": [frame.get("width"), frame.get("height")],
        "area": sum(areas),
        "outer": sum(a > 0 for a in areas),
        "holes": sum(a < 0 for a in areas),
        "box": box(rings),
    }


def box(rings):
    points = [point for ring in rings for point in ring]
    if not points:
        return None
    return [f(p[c] for p in points) for f in (min, max) for c in (0, 1)]


def dxf(path):
    try:
        import ezdxf
    except ImportError:
        return {"reader": "our own", **dxf_pairs(path)}
    document = ezdxf.readfile(path)
    audit = document.audit()
    lines = list(document.modelspace().query("LWPOLYLINE"))
    rings = {}
    for line in lines:
        ring = [(x, y) for x, y in line.get_points("xy")]
        rings.setdefault(line.dxf.layer, []).append(ring)
    return {
        "reader": f"ezdxf {ezdxf.__version__}",
        "errors": [str(e.message) for e in audit.errors + audit.fixes],
        "closed": all(line.closed for line in lines),
        "unit": document.header["$INSUNITS"],
        "version": document.dxfversion,
        **layers(rings),
    }


def layers(rings):
    areas = [shoelace(ring) for ring in rings.get("ELECTRODE", [])]
    return {
        "area": sum(areas),
        "outer": sum(a > 0 for a in areas),
        "holes": sum(a < 0 for a in areas),
        "frame": [shoelace(ring) for ring in rings.get("FRAME", [])],
        "layers": sorted(rings),
        "box": box(rings.get("ELECTRODE", [])),
    }


def dxf_pairs(path):
    lines = open(path, encoding="ascii").read().splitlines()
    pairs = [(int(code), value) for code, value in zip(lines[::2], lines[1::2])]
    rings, ring, closed, unit = {}, None, True, None
    for at, (code, value) in enumerate(pairs):
        if code == 0:
            ring = [] if value == "LWPOLYLINE" else None
        elif (code, value) == (9, "$INSUNITS"):
            unit = int(pairs[at + 1][1])
        elif ring is not None and code == 8:
            rings.setdefault(value, []).append(ring)
        elif ring is not None and code == 70:
            closed = closed and value == "1"
        elif ring is not None and code == 10:
            ring.append((float(value), float(pairs[at + 1][1])))
    return {"errors": [], "closed": closed, "unit": unit, "version": "AC1015", **layers(rings)}


def gbr(path):
    try:
        import gerbonara
    except ImportError:
        return {"reader": "our own", **gerber_words(path)}
    from importlib.metadata import version

    from gerbonara.utils import MM

    layer = gerbonara.GerberFile.open(path)
    contours = []
    for region in layer.objects:
        assert type(region).__name__ == "Region", region
        ring = [tuple(MM(v, region.unit) for v in point) for point in region.outline]
        contours.append((region.polarity_dark, ring[:-1] if ring[0] == ring[-1] else ring))
    return {
        "reader": f"gerbonara {version('gerbonara')}",
        "attributes": {key: list(value) for key, value in layer.file_attrs.items()},
        "comments": list(layer.comments),
        **polarities(contours),
    }


def polarities(contours):
    sign = lambda dark: 1 if dark else -1
    return {
        "area": sum(sign(dark) * abs(shoelace(ring)) for dark, ring in contours),
        "outer": sum(dark for dark, _ in contours),
        "holes": sum(not dark for dark, _ in contours),
        "box": box([ring for _, ring in contours]),
    }


def gerber_words(path):
    contours, comments, attributes, dark, ring = [], [], {}, True, None
    for line in open(path, encoding="ascii").read().splitlines():
        if line.startswith("G04"):
            comments.append(line[4:-1])
        elif line.startswith("%TF"):
            name, *values = line[3:-2].split(",")
            attributes[name] = values
        elif line.startswith("%LP"):
            dark = line[3] == "D"
        elif line == "G36*":
            ring = []
        elif line == "G37*":
            assert ring[0] == ring[-1], "a contour is open"
            contours.append((dark, ring[:-1]))
        elif line.startswith("X"):
            x, y = line[1 : line.index("D")].split("Y")
            ring.append((int(x) * 1e-6, int(y) * 1e-6))
    return {"attributes": attributes, "comments": comments, **polarities(contours)}


def png(path):
    data, at, chunks = open(path, "rb").read(), 8, {}
    while at < len(data):
        (length,), kind = struct.unpack(">I", data[at : at + 4]), data[at + 4 : at + 8].decode()
        chunks[kind] = chunks.get(kind, b"") + data[at + 8 : at + 8 + length]
        at += 12 + length
    width, height, depth, colour = struct.unpack(">IIBB", chunks["IHDR"][:10])
    across, up, unit = struct.unpack(">IIB", chunks["pHYs"])
    assert (depth, colour, unit) == (1, 0, 1)
    return {
        "reader": "zlib",
        "pixels": [width, height],
        "size_mm": [1e3 * width / across, 1e3 * height / up],
        "area": black(zlib.decompress(chunks["IDAT"]), width, height) * 1e6 / (across * up),
        "text": chunks["iTXt"].decode("utf-8", "replace"),
    }


def black(raw, width, height):
    """Counts black pixels of one bit each, after undoing the filters of the rows (PNG, 3rd edition, 9)."""
    stride, before, count = (width + 7) // 8, bytes((width + 7) // 8), 0
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for i in range(stride):
            left, up, corner = (row[i - 1] if i else 0), before[i], (before[i - 1] if i else 0)
            guess = left + up - corner
            paeth = min((left, up, corner), key=lambda v: abs(guess - v))
            row[i] = (row[i] + (0, left, up, (left + up) // 2, paeth)[kind]) % 256
        count += width - sum(bin(b).count("1") for b in row)
        if width % 8:
            count += bin(row[-1] & (0xFF >> width % 8)).count("1")
        before = row
    return count


def vtkhdf(path):
    try:
        import pyvista
    except ImportError:
        pyvista = None
    if pyvista is None:
        reader, points, cells, point_data, cell_data = "h5py", *hdf(path)
    else:
        mesh = pyvista.read(path)
        reader, points, cells = f"pyvista {pyvista.__version__}", mesh.points, mesh.cells_dict[9]
        assert len(mesh.cells_dict) == 1, mesh.cells_dict
        point_data, cell_data = dict(mesh.point_data), dict(mesh.cell_data)
    corners = points[cells][:, :, :2]
    following = corners[:, [1, 2, 3, 0]]
    areas = 0.5 * (corners[:, :, 0] * following[:, :, 1] - corners[:, :, 1] * following[:, :, 0]).sum(axis=1)
    deformed = abs(points - point_data["reference"] - point_data["displacement"]).max()
    shapes = {name: list(values.shape) for name, values in {**point_data, **cell_data}.items()}
    active = cell_data["active"] == 1
    # Incompressible: the volume of each element stays that of 1 mm thickness at a prestretch of 3.
    volume = (areas * cell_data["thickness"]).sum()
    return {
        "reader": reader,
        "points": len(points),
        "cells": len(cells),
        "smallest_area": areas.min(),
        "area": areas.sum(),
        "volume": volume,
        "active": float(active.mean()),
        "deformed": deformed,
        "largest": float((point_data["displacement"] ** 2).sum(axis=1).max() ** 0.5),
        "field": [float(cell_data["electric_field"][active].min(initial=1e99)), float(cell_data["electric_field"].max())],
        "field_elsewhere": float(cell_data["electric_field"][~active].max(initial=0.0)),
        "stress": [float(cell_data["principal_stresses"].min()), float(cell_data["first_piola_stress"].max())],
        "shapes": shapes,
    }


def hdf(path):
    import h5py

    with h5py.File(path) as file:
        root = file["VTKHDF"]
        assert list(root.attrs["Version"]) == [2, 0] and root.attrs["Type"] == b"UnstructuredGrid", dict(root.attrs)
        assert (root["Types"][:] == 9).all() and (root["Offsets"][:] == range(0, 4 * len(root["Types"]) + 1, 4)).all()
        assert root["NumberOfPoints"][0] == len(root["Points"]) and root["NumberOfCells"][0] == len(root["Types"])
        assert root["NumberOfConnectivityIds"][0] == len(root["Connectivity"])
        data = [{name: values[:] for name, values in root[group].items()} for group in ("PointData", "CellData")]
        return root["Points"][:], root["Connectivity"][:].reshape(-1, 4), *data


for name in sys.argv[1:]:
    print(json.dumps(globals()[name.rsplit(".", 1)[1]](name), default=float))
