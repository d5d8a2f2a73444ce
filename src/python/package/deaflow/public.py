"""The classes and functions of the package that need numpy; `deaflow` imports them when one is used."""

from .arrays import Arrays, NotFound
from .model import Model
from .pipeline import PipelineRun, run
from .result import Result
from .scene import Scene
from .store import Artifact, Run, StoreError, load, open, runs

__all__ = [
    "Arrays",
    "Artifact",
    "Model",
    "NotFound",
    "PipelineRun",
    "Result",
    "Run",
    "Scene",
    "StoreError",
    "load",
    "open",
    "run",
    "runs",
]

# Messages and documentation name them as users do.
for _public in (Arrays, Artifact, Model, NotFound, PipelineRun, Result, Run, Scene, StoreError, load, open, run, runs):
    _public.__module__ = "deaflow"
