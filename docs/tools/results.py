#!/usr/bin/env python3
"""Writes the tables of docs/results.md from finished runs:

    deaflow run pipelines/paper.yaml --json > paper.json
    deaflow run pipelines/ablation.yaml --json > ablation.json
    deaflow run pipelines/cases.yaml --json > cases.json
    python3 docs/tools/results.py paper.json ablation.json cases.json

Any of the files may be left out; its tables then stay unchanged. The table of claims needs `paper` and `cases`. A finished pipeline is not run again. Needs h5py to read the times of the methods from the provenance of
the artifact. With --write the tables replace those between their marks in docs/results.md; tables without marks there are printed.
"""
import json
import math
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
        rows.append([f"`{c['name']}`: whole field in its interval"] + percent(c["field"]))
        rows.append(["median radius, mm"] + [short(c["radius_mm"][k]) for k in place])
        rows.append(["flagged as out of distribution"] + percent(c["unlike"]))
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
        if front or method.startswith("network"):
            lines.append([f"`{method}`", f"{1e3 * time:.2f}", short(error), short(most), front])
    return table(["method", "ms of one core per pattern", "RMS error, mm", "largest, mm", "front"], lines)


def trainings(run):
    return "\n".join(f"    {line}" for line in run["trainings"])


def designs(run):
    """Returns the designs of the last round."""
    return run["results"][-1]["rows"]


def of(rows, case, role=None, name=None, units=None, member=None):
    wanted = {"case": case, "role": role, "name": name, "units": units, "member": member}
    return [r for r in rows if all(value is None or r[key] == value for key, value in wanted.items())]


def percent(value, digits=1):
    return "" if value is None else f"{100 * value:+.{digits}f} %"


def share(value):
    return "" if value is None else f"{100 * value:.2f} %"


def mm(value, digits=3):
    return "" if value is None else f"{value:.{digits}f}"


def beside(rows, row):
    """Returns the optimum on all cells and the one on the units of the genetic algorithm."""
    optima = {o["units"]: o["simulated_mm"] for o in of(rows, row["case"], "optimum", row["name"])}
    return optima.get(50), optima.get(20)


def case_one(rows):
    lines = []
    for row in of(rows, "I", "refined"):
        (ga,) = of(rows, "I", "ga", row["name"])
        best, _ = beside(rows, row)
        lines.append(
            [
                row["name"],
                mm(row["simulated_mm"], 4),
                f"{100 * abs(row['difference_mm'] / row['simulated_mm']):.2f} %",
                share(row["simulated_mm"] / best),
                share(ga["simulated_mm"] / best),
                percent(row["gain_own_area"]),
                percent(row["gain_equal_area"]),
            ]
        )
    head = ["design", "refined, mm", "prediction error", "refined / best by gradients"]
    return table(head + ["GA / best by gradients", "gain, own area", "gain, equal area"], lines)


def case_two(rows):
    """Returns every third area of the sweep: both ends, half and the largest displacement are among them."""
    lines = []
    for row in of(rows, "II", "refined")[::3]:
        (ga,) = of(rows, "II", "ga", row["name"])
        best, _ = beside(rows, row)
        lines.append(
            [
                row["name"].removeprefix("area-") + " %",
                mm(row["simulated_mm"]),
                f"{100 * abs(row['difference_mm'] / row['simulated_mm']):.2f} %",
                share(row["simulated_mm"] / best),
                share(ga["simulated_mm"] / best),
                percent(row["gain_equal_area"]),
            ]
        )
    head = ["area", "refined, mm", "prediction error", "refined / best by gradients"]
    return table(head + ["GA / best by gradients", "gain over intuitive, equal area"], lines)


def case_three(rows):
    lines = []
    for case, title in (("III-centripetal", "centripetal"), ("III-rotation", "rotation")):
        (row,), (ga,) = of(rows, case, "refined"), of(rows, case, "ga")
        (own,) = of(rows, case, "intuitive")
        best, on_units = beside(rows, row)
        angle = lambda value: f"{value:.3f} mm" + (f" = {turned(value):.2f}°" if title == "rotation" else "")
        lines.append(
            [
                title,
                angle(row["simulated_mm"]),
                angle(best),
                share(row["simulated_mm"] / best),
                share(ga["simulated_mm"] / on_units),
                angle(own["simulated_mm"]),
            ]
        )
    return table(["case", "refined", "best by gradients", "refined / best by gradients", "GA / best by gradients on its units", "intuitive"], lines)


def turned(value):
    """Returns the rotation in degrees of points 12.5 mm from the centre in both directions that move along the circle."""
    return math.degrees(math.atan2(value, 12.5 * math.sqrt(2)))


def case_four(rows):
    (best,) = of(rows, "IV-max", "optimum")
    lines = []
    for member in range(8):
        (far,), (one,) = of(rows, "IV-max", "refined", member=member), of(rows, "IV-1mm", "refined", member=member)
        lines.append(
            [
                str(member + 1),
                mm(far["simulated_mm"], 4),
                share(far["simulated_mm"] / best["simulated_mm"]),
                mm(one["simulated_mm"], 4),
                share(one["area"]),
            ]
        )
    return table(["design", "near the maximum, mm", "fraction of the best by gradients", "target 1.00 mm, mm", "area"], lines)


def difference(rows):
    """Returns the sentence about the largest difference between predictions and simulations of all searched designs."""
    searched = of(rows, None, "ga") + of(rows, None, "refined")
    differ = max(abs(r["difference_mm"] / r["simulated_mm"]) for r in searched)
    return f"Predictions and simulations of the designs found by the search differ by at most {100 * differ:.2f} %."


def beyond(value, paper):
    """Returns the verdict on a displacement that the paper measured smaller."""
    return f"overpredicted by {100 * (value / paper - 1):.0f} %"


def claims(rows, judged):
    one = [r["gain_own_area"] for r in of(rows, "I", "refined")]
    equal = [r["gain_equal_area"] for r in of(rows, "I", "refined")]
    (centre,) = of(rows, "I", "refined", "centre-0")
    (best,) = of(rows, "I", "optimum", "centre-0", 50)
    curve = {r["name"].removeprefix("area-"): r["simulated_mm"] for r in of(rows, "II", "refined")}
    top = max(curve, key=curve.get)
    (inwards,), (turn,) = of(rows, "III-centripetal", "refined"), of(rows, "III-rotation", "refined")
    far = [r["simulated_mm"] for r in of(rows, "IV-max", "refined")]
    exact = [abs(r["simulated_mm"] - 1) for r in of(rows, "IV-1mm", "refined")]
    (network,) = [p for p in judged["predictors"] if p["name"] == "qin2024"]
    rmse = network["rmse_mm"]
    overall = rmse[judged["families"].index("all")]
    lines = [
        [
            "RMSE of the paper's network on fresh patterns",
            "≤ 0.065",
            f"{short(overall)} mm over all families, {short(max(rmse))} on the worst",
            "yes",
        ],
        [
            "centre at half area, gain over the half plane",
            "21.7 %",
            f"{percent(centre['gain_own_area'], 2)}; best of the gradient search {percent(best['gain_own_area'], 2)}",
            "no: the searches find far less, at three values of κ (next table)",
        ],
        [
            "eight pairs of point and direction, gain over the intuitive design",
            "about 30 %",
            f"{percent(min(one))} to {percent(max(one))} at its own area; {percent(min(equal))} to {percent(max(equal), 0)} at equal area",
            "not at its own area, where it may use more or less electrode; more at equal area",
        ],
        [
            "displacement of the centre over the area fraction",
            "rises, then falls",
            f"{mm(curve['05'], 2)} mm at 5 %, {mm(curve[top], 2)} at {top} %, {mm(curve['95'], 2)} at 95 %",
            "yes",
        ],
        ["centripetal motion of four points", "0.8 mm", mm(inwards["simulated_mm"], 2) + " mm", beyond(inwards["simulated_mm"], 0.8)],
        ["rotation of four points", "2°", f"{turned(turn['simulated_mm']):.2f}°", beyond(turned(turn["simulated_mm"]), 2)],
        [
            "eight designs near the maximum",
            "about 2.2 mm",
            f"{mm(min(far))} to {mm(max(far))} mm at half area, pairwise 5 % of the cells different",
            "no evidence: κ was chosen so that the centre moves this far",
        ],
        ["eight designs of 1.0 mm", "1.0 mm", f"1.00 mm within {max(exact):.4f} mm, pairwise 5 % different", "yes"],
    ]
    return table(["claim", "paper", "here, by finite elements", "supported by the stated physics"], lines)


def main():
    arguments = [a for a in sys.argv[1:] if a != "--write"]
    runs = {run["pipeline"]: run for run in (json.loads(pathlib.Path(a).read_text()) for a in arguments)}
    if not runs or set(runs) - {"paper", "ablation", "cases"}:
        sys.exit(__doc__)
    tables = {}
    if paper := runs.get("paper"):
        judged = evaluation(paper, "judged")
        tables |= {
            "trainings": trainings(paper),
            "rmse": by_family(judged, "rmse_mm", short),
            "max-r2": by_family(judged, "max_displacement_r2", lambda v: f"{v:.5f}"),
            "area": by_area(judged),
            "coverage": coverage(judged),
            "accuracy": accuracy(paper),
        }
    if ablation := runs.get("ablation"):
        fig3 = evaluation(ablation, "ablation")
        tables |= {
            "ablation-rmse": by_family(fig3, "rmse_mm", short),
            "ablation-r2": by_family(fig3, "max_displacement_r2", lambda v: f"{v:.3f}"),
        }
    if cases := runs.get("cases"):
        rows = designs(cases)
        tables |= {
            "difference": difference(rows),
            "case-1": case_one(rows),
            "case-2": case_two(rows),
            "case-3": case_three(rows),
            "case-4": case_four(rows),
        }
    if paper and cases:
        tables["claims"] = claims(rows, judged)
    if "--write" not in sys.argv:
        for name, text in tables.items():
            print(f"## {name}\n\n{text}\n")
        return
    path = pathlib.Path(__file__).parent.parent / "results.md"
    text = path.read_text()
    for name, made in tables.items():
        marks = re.compile(rf"(<!-- {name} -->\n)(?:(?!<!-- end -->).)*(<!-- end -->)", re.S)
        if not marks.search(text):
            print(f"## {name}\n\n{made}\n")
        text = marks.sub(lambda found: f"{found[1]}{made}\n{found[2]}", text)
    path.write_text(text)


if __name__ == "__main__":
    main()
