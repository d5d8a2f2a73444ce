"""deaflow: design of dielectric-elastomer actuators.

>>> import deaflow, numpy as np
>>> scene = deaflow.Scene.read("pipelines/scenes/vhb4910.yaml", {"drive.voltage": "4 kV"})
>>> result = scene.solve(np.eye(50, dtype=int))
>>> result.displacement.shape, result.outcome[0]
((1, 51, 51, 2), 'converged')

Arrays are those of the HDF5 files of the command `deaflow`: ``[sample][y][x]`` with the origin at the lower left
corner, vectors last, displacements in mm. See docs/python.md.
"""

from ._deaflow import Error, __version__
from .arrays import Arrays, NotFound
from .model import Model
from .pipeline import PipelineRun, run
from .result import Result
from .scene import Scene
from .store import Artifact, Run, StoreError, load, open, runs

__all__ = [
    "Arrays",
    "Artifact",
    "Error",
    "Model",
    "NotFound",
    "PipelineRun",
    "Result",
    "Run",
    "Scene",
    "StoreError",
    "__version__",
    "load",
    "open",
    "run",
    "runs",
]

# Messages and documentation name them as users do.
for _public in (Arrays, Artifact, Model, NotFound, PipelineRun, Result, Run, Scene, StoreError, load, open, run, runs):
    _public.__module__ = __name__
