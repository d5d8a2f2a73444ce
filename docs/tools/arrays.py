#!/usr/bin/env python3
"""Writes docs/arrays.md from the schema of artifacts:

    deaflow schema artifacts | python3 docs/tools/arrays.py > docs/arrays.md
"""

import json
import sys

HEAD = """# Arrays of artifacts

Written by `deaflow schema artifacts | python3 docs/tools/arrays.py > docs/arrays.md`; a test compares both. Arrays that share
an axis have the same length along it; axes with a number have that length in every artifact. `y` and `x` are the rows and columns of cells,
`corner_y` and `corner_x` those of their corners, one more of each. Arrays in *italics* are optional. Times are not part of the
content: they are in the attribute `measurements` of `/provenance`.
"""


def axes(array):
    """Returns the axes, slowest first, with fixed lengths."""
    free = len(array["axes"]) - len(array["extents"])
    fixed = [f"{name} {extent}" for name, extent in zip(array["axes"][free:], array["extents"])]
    return ", ".join(array["axes"][:free] + fixed)


def row(array):
    """Returns a line of the table."""
    path = f"`{array['path']}`"
    if array["optional"]:
        path = f"*{path}*"
    return f"| {path} | {array['type']} | {axes(array)} | {array['units']} | {array['description']} |"


def heading(name):
    """Returns the heading for the name of a kind or the description of a file."""
    return f"`{name}`" if " " not in name else name[0].upper() + name[1:]


def main():
    """Writes the page."""
    print(HEAD)
    parts = []
    kinds = json.load(sys.stdin)
    # Kinds with the same content share a section.
    contents = []
    for kind in kinds:
        content = (kind["arrays"], kind["attributes"])
        if content not in contents:
            contents.append(content)
    for content in contents:
        alike = [kind for kind in kinds if (kind["arrays"], kind["attributes"]) == content]
        kind = alike[0]
        title = ", ".join(heading(other["kind"]) for other in alike)
        lines = [f"## {title}", "", "| array | type | axes | unit | |", "|---|---|---|---|---|"]
        lines += [row(array) for array in kind["arrays"]]
        if kind["attributes"]:
            lines += ["", "| attribute | |", "|---|---|"]
            lines += [f"| `{a['name']}` | {a['description']} |" for a in kind["attributes"]]
        parts.append("\n".join(lines))
    print("\n\n".join(parts))


if __name__ == "__main__":
    main()
