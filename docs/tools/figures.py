"""Puts the figures of finished runs where the documentation shows them.

    deaflow run pipelines/sweep.yaml
    python3 docs/tools/figures.py sweep

copies those of the pipelines that are named from `store/figures`, or from `figures` of the store in DEAFLOW_STORE, to `docs/figures`. Without a
name it lists which pipeline and stage draws which figure. `python.png` is drawn by the script in `docs/python.md`.
"""

import os
import pathlib
import shutil
import sys

from photographs import reduce

# Of each figure of the documentation the pipeline, the stage and the figure of that stage.
FIGURES = {
    "ablation": ("ablation", "ablation", "evaluation"),
    "accuracy": ("accuracy", "accuracy", "accuracy"),
    "audit": ("paper", "audited", "audit"),
    "cases": ("cases", "verified", "verification"),
    "deformation": ("paper", "solved", "deformation"),
    "evaluation": ("paper", "judged", "evaluation"),
    "histogram": ("paper", "balanced", "histogram"),
    "sweep": ("sweep", "moved", "table"),
    "training": ("paper", "physics", "training"),
    "verification": ("quickstart", "verified", "verification"),
    "worth": ("paper", "accuracy", "accuracy"),
}

# Those of few colours, which take a third to a half of the bytes with a palette.
CHARTS = {"accuracy", "audit", "cases", "evaluation", "histogram", "sweep", "training", "verification", "worth"}

# All of them together, bytes: they are fetched with every clone.
MOST = 1_200_000


def newest(folder, stage, figure):
    """The last drawn of the figures of a stage, whose names hold the digest of its artifact."""
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
