"""Runs pipelines."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Optional, Union

from ._deaflow import Error
from .process import own_command
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
    progress: Union[str, Callable[[dict[str, Any]], object]] = "none",
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
    progress : str or callable
        How progress is shown on stderr: "none" (default), "bars", "plain" or "json". A function is called with each
        event of "json" as a dict, with its name as ``"event"``; an exception in it stops the run.

    Returns
    -------
    PipelineRun
        The artifacts by stage.

    Raises
    ------
    Error
        If the pipeline is invalid or a stage fails.
    """
    words = [*own_command(), "run", os.fspath(pipeline), "--json"]
    if progress != "bars":
        words += ["--progress", progress if isinstance(progress, str) else "json"]
    words += [f"--set={key}={to_value(value)}" for key, value in (overrides or {}).items()]
    for option, value in (("--store", store), ("--until", until), ("--jobs", jobs)):
        words += [] if value is None else [option, str(value)]
    code, printed, errors = _outcome(words, progress)
    if code not in COMPLETE:
        raise _error(code, printed, errors)
    return PipelineRun(json.loads(printed))


def _outcome(words: list[str], progress: Union[str, Callable[[dict[str, Any]], object]]) -> tuple[int, str, str]:
    """Run a command; return its exit code, what it prints, and the errors that it has not shown itself."""
    is_shown = isinstance(progress, str) and progress != "none"
    errors: list[str] = []
    with tempfile.TemporaryFile("w+", encoding="utf-8") as printed:
        stderr = None if is_shown else subprocess.PIPE
        # In a session of its own it does not get the Ctrl-C of a terminal, and a second signal would end it at once.
        process = subprocess.Popen(words, stdout=printed, stderr=stderr, encoding="utf-8", start_new_session=True)
        try:
            for line in process.stderr or ():
                event = None if isinstance(progress, str) else _event(line)
                if event is None or isinstance(progress, str):
                    errors.append(line)
                else:
                    progress(event)
            process.wait()
        except BaseException:
            # It ends soon, and keeps what is finished.
            process.send_signal(signal.SIGINT)
            process.communicate()
            raise
        printed.seek(0)
        return process.returncode, printed.read(), "".join(errors)


def _event(line: str) -> Optional[dict[str, Any]]:
    """Return the event on a line of stderr; None for other lines, such as errors."""
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) and "event" in event else None


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
