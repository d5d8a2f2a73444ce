"""Reads the artifacts of a store with h5py: named numpy arrays with units, descriptions, axes and provenance.

docs/store.md and docs/runs.md describe the formats. Nothing is written and no locks are taken: a run may be in
progress.
"""

from __future__ import annotations

import difflib
import json
import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import NDArray

from .arrays import Arrays, NotFound, needed

__all__ = ["Artifact", "NotFound", "Run", "StoreError", "load", "open", "runs"]

FORMAT = "deaflow-store 2"
TITLE = "deaflow-artifact 1"
HEADER = 512
# Datasets and groups that the store adds to files.
OWN = ("parts", "provenance", "long_attributes")
RUN_FILE = re.compile(r"(\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d\.\d{3}Z)(?:\.(\d+))?-([0-9a-f]{12})\.json")

PathLike = Union[str, "os.PathLike[str]"]


class StoreError(Exception):
    """The folder is not a store of this format, or a file in it is damaged or missing."""


@dataclass(frozen=True)
class Run:
    """A run of a pipeline in the history of the store."""

    id: str
    pipeline: str
    path: str
    command: str
    created: str
    seconds: float
    host: str
    version: str
    overrides: dict[str, str]
    """Values changed by `--set`."""
    stages: dict[str, str]
    """Digest of the artifact of each finished stage."""
    failures: list[str]
    results: dict[str, float]
    """Numeric results of artifacts, as STAGE.RESULT."""


class Artifact(Arrays):
    """The arrays of an artifact by path, read on access; chunks are concatenated.

    Texts are arrays of `str`. Texts of any length, which a file stores as bytes and lengths (`objective/text` and
    `objective/length`), are one array (`objective`).
    """

    def __init__(self, path: PathLike, digest: str) -> None:
        self.path = Path(path)
        self.digest = digest
        """Digest of the content, the name in the store."""
        self.units: dict[str, str] = {}
        self.descriptions: dict[str, str] = {}
        self.dims: dict[str, tuple[str, ...]] = {}
        """Names of the axes, slowest first."""
        self.shapes: dict[str, tuple[int, ...]] = {}
        self._long: set[str] = set()
        with needed("h5py").File(self.path, "r") as file:
            attributes = _texts(file)
            self.kind: str = attributes.pop("kind", "").removesuffix(" chunk")
            self.attributes: dict[str, str] = attributes
            """Attributes of the content: scene, solver, …"""
            self.provenance: dict[str, str] = _texts(file["provenance"]) if "provenance" in file else {}
            """Provenance: kind, parameters, inputs, created, host, version, …"""
            file.visititems(self._visit)
        self._join_long_texts()

    def _visit(self, name: str, item: Any) -> None:
        if not isinstance(item, needed("h5py").Dataset) or name.split("/")[0] in OWN or "CLASS" in item.attrs:
            return
        self.units[name] = _text(item.attrs.get("units", b""))
        self.descriptions[name] = _text(item.attrs.get("description", b""))
        self.shapes[name] = item.shape
        axes = item.attrs.get("axes", item.attrs.get("DIMENSION_LABELS", ()))
        self.dims[name] = tuple(_text(axis) for axis in axes) or tuple(f"{name}_{k}" for k in range(item.ndim))

    def _join_long_texts(self) -> None:
        for length in [name for name in self.shapes if name.endswith("/length")]:
            path = length[: -len("/length")]
            if self.units.get(f"{path}/text") == "" and len(self.shapes[f"{path}/text"]) == 1:
                self._long.add(path)
                description = re.sub(r"[.;] UTF-8, one .*", "", self.descriptions[f"{path}/text"])
                self.units[path], self.descriptions[path] = "", description
                self.dims[path], self.shapes[path] = self.dims[length], self.shapes[length]
                for table in (self.units, self.descriptions, self.dims, self.shapes):
                    del table[length], table[f"{path}/text"]

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name not in self.shapes:
            raise NotFound(f"artifact {self.digest[:12]} has no array {name!r}{_near(name, self.shapes)}")
        with needed("h5py").File(self.path, "r") as file:
            if name in self._long:
                lengths = file[f"{name}/length"][...].astype(int)
                whole = file[f"{name}/text"][...].tobytes()
                ends = np.cumsum(lengths)
                return np.array([whole[end - n : end].decode() for end, n in zip(ends, lengths)], dtype=str)
            values = file[name][...]
        return np.char.decode(values, "utf-8") if values.dtype.kind == "S" else values

    def __repr__(self) -> str:
        return "\n".join([f"<deaflow {self.kind} {self.digest[:12]}>", *self._lines()])

    def _name(self) -> str:
        return f"artifact {self.digest[:12]}"

    def _about(self) -> dict[str, str]:
        return dict(self.attributes, kind=self.kind, digest=self.digest)

    def to_pandas(self, along: Optional[str] = None) -> Any:
        """As `Arrays.to_pandas`; an artifact of a `table` stage has its own rows, with NaN where a stage has no result."""
        frame = self._table() if self.kind == "table" and along is None else super().to_pandas(along)
        frame.attrs["digest"] = self.digest
        return frame

    def _table(self) -> Any:
        text, value, is_number = self["text"], self["value"], self["is_number"] == 1
        columns = {}
        for k, name in enumerate(self["columns"]):
            words = self["units"][k] == ""
            columns[name] = text[:, k] if words else np.where(is_number[:, k], value[:, k], np.nan)
        frame = needed("pandas").DataFrame(columns)
        frame.index.name = "row"
        frame.attrs = {"units": dict(zip(self["columns"], self["units"]))}
        return frame


def open(store: PathLike, name: str) -> Artifact:
    """Opens an artifact of a store.

    `name` is a stage of the last run with a stage of that name (`solved`), a stage of a pipeline by its name
    (`quickstart:solved`) or its file (`pipelines/quickstart.yaml:solved`), or the first four or more digits of a digest.

    Raises NotFound if there is none, and StoreError if the store or a file in it is invalid.
    """
    root = _root(store)
    pipeline, colon, stage = name.rpartition(":")
    digest = _of_runs(root, stage, pipeline if colon else None)
    if digest is None and not colon:
        digest = _of_digits(root, name)
    if digest is None:
        raise NotFound(_unknown(root, name, stage, pipeline if colon else None))
    path = _object(root, digest)
    _check(path, digest)
    with needed("h5py").File(path, "r") as file:
        parts = [_text(part) for part in file["parts"][...]] if "parts" in file else []
    for part in parts:
        # HDF5 would return fill values for a missing chunk.
        _check(_object(root, part), part)
    return Artifact(path, digest)


def load(path: PathLike) -> Artifact:
    """Opens a file of `deaflow export artifact`."""
    try:
        with needed("h5py").File(path, "r") as file:
            texts = _texts(file["provenance"]) if "provenance" in file else {}
    except OSError as error:
        raise StoreError(f"{path} cannot be read as HDF5: {error}") from error
    if "artifact" not in texts:
        why = "was not written by `deaflow export artifact`; to read a store use `open` with the name of a stage"
        raise StoreError(f"{path} {why}")
    return Artifact(path, texts["artifact"])


def runs(store: PathLike, pipeline: Optional[str] = None) -> list[Run]:
    """Returns the runs in the history, newest first; optionally those of one pipeline, by its name or its file."""
    return [run for run in _runs(_root(store)) if pipeline is None or _is_of(run, pipeline)]


def _root(store: PathLike) -> Path:
    root = Path(store)
    try:
        found = (root / "format").read_text(errors="replace").strip()
    except OSError as error:
        raise StoreError(f"there is no artifact store at {root}") from error
    if found != FORMAT:
        raise StoreError(f"{root / 'format'} says {found!r}; this reader knows {FORMAT!r}")
    return root


def _runs(root: Path) -> Iterator[Run]:
    files = []
    for path in (root / "runs").glob("*.json"):
        named = RUN_FILE.fullmatch(path.name)
        if named and path.is_file() and not path.is_symlink():
            files.append((named[1], int(named[2] or 0), named[3], path))
    for _, _, digits, path in sorted(files, reverse=True):
        try:
            run = json.loads(path.read_text())
            yield Run(
                id=digits,
                pipeline=run["pipeline"],
                path=run["path"],
                command=run.get("command", "run"),
                created=run["created"],
                seconds=run.get("seconds", 0.0),
                host=run.get("host", ""),
                version=run.get("version", ""),
                overrides=run.get("overrides", {}),
                stages={stage["name"]: stage["artifact"] for stage in run["stages"]},
                failures=run.get("failures", []),
                results=run.get("results", {}),
            )
        except (OSError, ValueError, KeyError, TypeError):
            continue  # As in deaflow: invalid files are ignored; `deaflow fsck` lists them.


def _is_of(run: Run, pipeline: str) -> bool:
    folder, name = os.path.split(os.path.abspath(pipeline))
    return pipeline == run.pipeline or os.path.join(os.path.realpath(folder), name) == run.path


def _of_runs(root: Path, stage: str, pipeline: Optional[str]) -> Optional[str]:
    for run in _runs(root):
        if stage in run.stages and (pipeline is None or _is_of(run, pipeline)):
            return run.stages[stage]
    return None


def _of_digits(root: Path, digits: str) -> Optional[str]:
    digits = digits.lower()
    if not re.fullmatch("[0-9a-f]{4,64}", digits):
        return None
    found = [path.stem for path in (root / "objects" / digits[:2]).glob("*.h5") if path.stem.startswith(digits)]
    if len(found) > 1:
        raise NotFound(f"{len(found)} artifacts start with {digits}")
    return found[0] if found else None


def _unknown(root: Path, name: str, stage: str, pipeline: Optional[str]) -> str:
    known = list(_runs(root))
    if not known:
        return f"{name!r} not found: there are no runs in {root}"
    if pipeline is not None and not any(_is_of(run, pipeline) for run in known):
        names = sorted({run.pipeline for run in known})
        return f"no pipeline {pipeline!r} has been run in {root}{_near(pipeline, names)}"
    last = next(run for run in known if pipeline is None or _is_of(run, pipeline))
    return f"no run in {root} has a stage {stage!r}, and no digest starts with it{_near(stage, last.stages)}"


def _near(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known), 1)
    return f": did you mean {close[0]!r}?" if close else f"; there are: {', '.join(sorted(known))}"


def _object(root: Path, digest: str) -> Path:
    if not re.fullmatch("[0-9a-f]{64}", digest):
        raise StoreError(f"{digest!r} is not a digest")
    return root / "objects" / digest[:2] / f"{digest}.h5"


def _check(path: Path, digest: str) -> None:
    """Compares the header of an artifact with its name and length; `deaflow fsck` compares every byte."""
    if not path.is_file():
        raise StoreError(f"artifact {digest[:12]} is missing: no {path}")
    with path.open("rb") as file:
        lines = file.read(HEADER).split(b"\0")[0].decode(errors="replace").splitlines()
    if len(lines) != 4 or lines[0] != TITLE or lines[1] != digest or lines[3] != str(path.stat().st_size):
        raise StoreError(f"{path} is damaged: run `deaflow fsck` to find all damaged files")


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _texts(group: Any) -> dict[str, str]:
    """Returns the attributes of a group, including long ones that are stored as datasets of bytes."""
    texts = {name: _text(value) for name, value in group.attrs.items()}
    long = group.get("long_attributes", {})
    return {**texts, **{name: item[()].tobytes().decode() for name, item in long.items()}}
