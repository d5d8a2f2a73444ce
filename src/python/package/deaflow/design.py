"""Searches for designs, by a pipeline of one stage."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Mapping
from typing import Any, Optional, Union

from .arrays import needed
from .pipeline import run
from .result import Result
from .values import to_json

PathLike = Union[str, "os.PathLike[str]"]


def design(
    scene: str,
    stage: Mapping[str, Any],
    store: Optional[PathLike],
    jobs: Optional[int],
    callback: Optional[Callable[[str], object]],
) -> Result:
    """Search in a scene with the keys of a stage of kind `design`: see `Scene.design`."""

    def show(event: dict[str, Any]) -> None:
        if callback is not None and event["event"] == "note":
            callback(event["text"])

    # Reads the result: without it a long search would be lost.
    needed("h5py")
    with tempfile.TemporaryDirectory(prefix="deaflow-") as folder:
        pipeline = os.path.join(folder, "design.yaml")
        stages = to_json({"design": {"kind": "design", **stage}})
        with open(pipeline, "w", encoding="utf-8") as file:
            file.write(f"version: 1\nname: design\nscene: {scene}\nstages: {stages}\n")
        kept = os.path.join(folder, "store") if store is None else store
        found = run(pipeline, store=kept, jobs=jobs, progress=show)
        artifact = found["design"]
        arrays = {
            name: (artifact[name], artifact.units[name], artifact.descriptions[name], list(artifact.dims[name]))
            for name in artifact
        }
        return Result._of(arrays, dict(artifact.attributes), found.document.get("warnings", []))
