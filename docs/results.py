#!/usr/bin/env python3
"""The tables of docs/results.md, from finished runs:

    deaflow run pipelines/paper.yaml --json > paper.json
    deaflow run pipelines/ablation.yaml --json > ablation.json
    python3 docs/results.py paper.json ablation.json

A finished pipeline is not run again for it. Needs h5py, for the times of the methods, which are no content of an artifact but
stand in its provenance. With --write the tables are put between their marks in docs/results.md.
"""
import json
import pathlib
import re
import sys

import h5py

FAMILIES = ["small-grid", "large-grid", "bezier", "area-sweep", "stripes", "blobs", "curves", "all"]
TITLES = {"small-grid": "small grid", "large-grid": "large grid", "bezier": "Bézier", "area-sweep": "area sweep"}


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def short(value):
    if value == 0:
        return "0"
    return f"{value:.2g}" if value < 0.1 else f"{value:.3g}"


def evaluation(run, stage):
    (found,) = [e for e in run["evaluations"] if e["stage"] == stage]
    return found


def by_family(found, key, shown, names=None):
    families = [f for f in FAMILIES if f in found["families"]]
    place = [found["families"].index(f) for f in families]
    head = [""] + [TITLES.get(f, f) for f in families]
    rows = []
    for predictor in found["predictors"]:
        if names is None or predictor["name"] in names:
            rows.append([f"`{predictor['name']}`"] + [shown(predictor[key][k]) for k in place])
    return table(head, rows)


def by_area(found):
    areas = [a["area"] for a in found["predictors"][0]["by_area"] if a["samples"]]
    head = ["area"] + [f"`{p['name']}`" for p in found["predictors"]]
    rows = []
    for area in areas:
        row = [f"{100 * area:.0f} %"]
        for predictor in found["predictors"]:
            (at,) = [a for a in predictor["by_area"] if a["area"] == area]
            row.append(short(at["rmse_mm"]))
        rows.append(row)
    return table(head, rows)


def coverage(found):
    families = [f for f in FAMILIES if f in found["families"]]
    place = [found["families"].index(f) for f in families]
    percent = lambda values: [f"{100 * values[k]:.1f} %" for k in place]
    rows = []
    for c in found["calibrations"]:
        rows.append([f"`{c['name']}`: whole field in its band"] + percent(c["field"]))
        rows.append(["median radius, mm"] + [short(c["radius_mm"][k]) for k in place])
        for objective in c["objectives"]:
            rows.append([objective["objective"]] + percent(objective["covered"]))
        rows.append(["flagged as unlike the training"] + percent(c["unlike"]))
    return table([""] + [TITLES.get(f, f) for f in families], rows)


def accuracy(run):
    (stage,) = [s for s in run["stages"] if s["name"] == "accuracy"]
    digest = stage["digest"]
    path = pathlib.Path(run["store"]) / "objects" / digest[:2] / f"{digest}.h5"
    with h5py.File(path) as artifact:
        methods = [m.decode() for m in artifact["methods"][:]]
        families = [f.decode() for f in artifact["families"][:]]
        rms, largest = artifact["error/rms"][:], artifact["error/max"][:]
        text = artifact["provenance"].attrs["measurements"]
    text = text.decode() if isinstance(text, bytes) else text
    seconds = dict(line.rsplit(": ", 1) for line in text.splitlines())
    rows = []
    for k, method in enumerate(methods):
        times = [float(seconds[f"{method}; {family}"]) for family in families]
        rows.append([sum(times) / len(times), (rms[k] ** 2).mean() ** 0.5, largest[k].max(), method])
    rows.sort()
    best, lines = float("inf"), []
    for time, error, most, method in rows:
        front, best = ("*" if error < best else ""), min(best, error)
        lines.append([f"`{method}`", f"{1e3 * time:.2f}", short(error), short(most), front])
    return table(["method", "ms of one core per pattern", "RMS error, mm", "largest, mm", "front"], lines)


def trainings(run):
    return "\n".join(f"    {line}" for line in run["trainings"])


def main():
    arguments = [a for a in sys.argv[1:] if a != "--write"]
    if len(arguments) != 2:
        sys.exit(__doc__)
    paper, ablation = [json.loads(pathlib.Path(a).read_text()) for a in arguments]
    judged, fig3 = evaluation(paper, "judged"), evaluation(ablation, "ablation")
    tables = {
        "trainings": trainings(paper),
        "rmse": by_family(judged, "rmse_mm", short),
        "max-r2": by_family(judged, "max_displacement_r2", lambda v: f"{v:.5f}"),
        "area": by_area(judged),
        "coverage": coverage(judged),
        "accuracy": accuracy(paper),
        "ablation-rmse": by_family(fig3, "rmse_mm", short),
        "ablation-r2": by_family(fig3, "max_displacement_r2", lambda v: f"{v:.3f}"),
    }
    if "--write" not in sys.argv:
        for name, text in tables.items():
            print(f"## {name}\n\n{text}\n")
        return
    path = pathlib.Path(__file__).with_name("results.md")
    text = path.read_text()
    for name, made in tables.items():
        marks = re.compile(rf"(<!-- {name} -->\n)(?:(?!<!-- end -->).)*(<!-- end -->)", re.S)
        if not marks.search(text):
            sys.exit(f"{path} has no place for {name}")
        text = marks.sub(lambda found: f"{found[1]}{made}\n{found[2]}", text)
    path.write_text(text)


if __name__ == "__main__":
    main()
