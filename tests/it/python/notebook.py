"""Runs the code of a notebook: python notebook.py FILE. Cells with figures are run where matplotlib is installed."""

import importlib.util
import json
import sys

with open(sys.argv[1], encoding="utf-8") as file:
    cells = json.load(file)["cells"]
has_figures = importlib.util.find_spec("matplotlib") is not None
if has_figures:
    import matplotlib

    matplotlib.use("agg")
space = {"__name__": "__main__"}
count = 0
for at, cell in enumerate(cells):
    if cell["cell_type"] != "code":
        continue
    assert cell["outputs"] == [] and cell["execution_count"] is None, "notebooks are kept without outputs"
    if "figure" in cell["metadata"].get("tags", []) and not has_figures:
        continue
    exec(compile("".join(cell["source"]), f"cell {at}", "exec"), space)
    count += 1
print(f"ran {count} cells")
