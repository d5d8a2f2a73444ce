"""Runs pipelines."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from typing import Any, Optional, Union

from ._deaflow import Error
from .store import Artifact
from .store import open as open_artifact
from .values import to_value

PathLike = Union[str, "os.PathLike[str]"]

# Exit codes of runs that have built all stages: done, and done with patterns without a stable solution.
COMPLETE = (0, 3)


class PipelineRun(Mapping[str, Artifact]):
    """The stages of a run: ``run["verified"].displacement``.

    Attributes
    ----------
    document : dict
        What ``deaflow run --json`` prints: stages, results, warnings.
    store : str
        The folder of the store.
    """

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document
        self.store: str = document["store"]
        self._digests = {stage["name"]: stage["digest"] for stage in document["stages"] if stage["digest"]}

    def __getitem__(self, stage: str) -> Artifact:
        return open_artifact(self.store, self._digests[stage])

    def __iter__(self) -> Iterator[str]:
        return iter(self._digests)

    def __len__(self) -> int:
        return len(self._digests)

    def __repr__(self) -> str:
        return f"<deaflow run of {self.document['pipeline']}: {', '.join(self)}>"


def run(
    pipeline: PathLike,
    overrides: Optional[Mapping[str, Any]] = None,
    *,
    store: Optional[PathLike] = None,
    until: Optional[str] = None,
    jobs: Optional[int] = None,
    progress: str = "none",
) -> PipelineRun:
    """Build the stale stages of a pipeline, as ``deaflow run`` does, with the same store, keys and digests.

    The run is a process of its own. Ctrl-C stops it; finished work is kept.

    Parameters
    ----------
    pipeline : path
        The YAML file.
    overrides : mapping, optional
        Values to change, as by ``--set``: ``{"scene.drive.voltage": "4 kV"}``.
    store : path, optional
        The folder of the store; by default that of the command.
    until : str, optional
        Only this stage and its inputs.
    jobs : int, optional
        Number of threads.
    progress : str
        How progress is shown on stderr: "none" (default), "bars", "plain" or "json".

    Returns
    -------
    PipelineRun
        The artifacts by stage.

    Raises
    ------
    Error
        If the pipeline is invalid or a stage fails.
    """
    words = [sys.executable, "-m", "deaflow", "run", os.fspath(pipeline), "--json"]
    words += [] if progress == "bars" else ["--progress", progress]
    words += [f"--set={key}={to_value(value)}" for key, value in (overrides or {}).items()]
    for option, value in (("--store", store), ("--until", until), ("--jobs", jobs)):
        words += [] if value is None else [option, str(value)]
    stderr = subprocess.PIPE if progress == "none" else None
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=stderr, text=True, env=_environment())
    try:
        printed, errors = process.communicate()
    except KeyboardInterrupt:
        # It was interrupted too, and keeps what is finished.
        process.communicate()
        raise
    if process.returncode not in COMPLETE:
        raise _error(process.returncode, printed, errors or "")
    return PipelineRun(json.loads(printed))


def _environment() -> dict[str, str]:
    """Return the environment, in which the process finds the same package."""
    package = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def _error(code: int, printed: str, errors: str) -> Error:
    try:
        about = json.loads(printed).get("error") or {}
    except ValueError:
        about = {}
    text = errors.strip() or about.get("message") or f"deaflow run ended with exit code {code}"
    raised = Error(text)
    raised.code = code
    raised.message = about.get("message") or text.splitlines()[0]
    raised.help, raised.file = about.get("help"), about.get("file")
    raised.line, raised.column = about.get("line"), about.get("column")
    return raised
