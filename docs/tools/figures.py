"""Copies figures of finished runs to the documentation.

    deaflow run pipelines/sweep.yaml
    python3 docs/tools/figures.py sweep

copies the figures of the named pipelines from `store/figures`, or from `figures` of the store in DEAFLOW_STORE, to `docs/figures`. Without a
name it lists pipeline and stage of each figure. `python.png` is drawn by the script in `docs/python.md`.
"""

import os
import pathlib
import shutil
import sys

from photographs import reduce

# For each figure of the documentation: pipeline, stage, and figure of that stage.
FIGURES = {
    "ablation": ("ablation", "ablation", "evaluation"),
    "accuracy": ("accuracy", "accuracy", "accuracy"),
    "audit": ("paper", "audited", "audit"),
    "cases": ("cases", "verified", "verification"),
    "deformation": ("paper", "solved", "deformation"),
    "evaluation": ("paper", "judged", "evaluation"),
    "histogram": ("paper", "balanced", "histogram"),
    "stroke": ("linear-actuator", "stroke", "table"),
    "sweep": ("sweep", "moved", "table"),
    "training": ("paper", "physics", "training"),
    "verification": ("quickstart", "verified", "verification"),
    "worth": ("paper", "accuracy", "accuracy"),
    "yields": ("tolerances", "made", "yields"),
}

# Figures with few colours: a palette reduces them to a third or a half of the bytes.
CHARTS = {"accuracy", "audit", "cases", "evaluation", "histogram", "stroke", "sweep", "training", "verification", "worth", "yields"}

# Limit of the total size in bytes, because every clone fetches the figures.
MOST = 1_300_000


def newest(folder, stage, figure):
    """Returns the newest figure of a stage; file names contain the digest of the artifact."""
    drawn = [path for path in folder.glob(f"{stage}-????????-{figure}.png")]
    return max(drawn, key=lambda path: path.stat().st_mtime, default=None)


def main(pipelines):
    docs = pathlib.Path(__file__).resolve().parent.parent / "figures"
    store = pathlib.Path(os.environ.get("DEAFLOW_STORE", "store"))
    known = {pipeline for pipeline, _, _ in FIGURES.values()}
    if not pipelines:
        for name, (pipeline, stage, figure) in FIGURES.items():
            print(f"docs/figures/{name}.png: `{figure}` of stage `{stage}` of pipelines/{pipeline}.yaml")
    for unknown in sorted(set(pipelines) - known):
        sys.exit(f"no figure of the documentation is of pipeline `{unknown}`; of these are some: {', '.join(sorted(known))}")
    for name, (pipeline, stage, figure) in FIGURES.items():
        if pipeline not in pipelines:
            continue
        drawn = newest(store / "figures" / pipeline, stage, figure)
        if drawn is None:
            sys.exit(f"`{figure}` of stage `{stage}` is not in {store}/figures: deaflow run pipelines/{pipeline}.yaml draws it")
        shutil.copyfile(drawn, docs / f"{name}.png")
        if name in CHARTS:
            reduce(docs / f"{name}.png")
        print(f"docs/figures/{name}.png")
    size = sum(path.stat().st_size for path in docs.glob("*.png"))
    if size > MOST:
        sys.exit(f"the figures take {size / 1e6:.2f} MB together, more than {MOST / 1e6:.1f} MB")


if __name__ == "__main__":
    main(sys.argv[1:])
