"""deaflow: design of dielectric-elastomer actuators.

>>> import deaflow, numpy as np
>>> scene = deaflow.Scene.read("pipelines/scenes/vhb4910.yaml", {"drive.voltage": "4 kV"})
>>> result = scene.solve(np.eye(50, dtype=int))
>>> result.displacement.shape, result.outcome[0]
((1, 51, 51, 2), 'converged')

Arrays are those of the HDF5 files of the command `deaflow`: ``[sample][y][x]`` with the origin at the lower left
corner, vectors last, displacements in mm. See docs/python.md.
"""

from typing import TYPE_CHECKING, Any

from ._deaflow import Error, __version__

if TYPE_CHECKING:
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


def __getattr__(name: str) -> Any:
    """Import what needs numpy when it is first used: the command starts without."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import public

    globals().update({name: getattr(public, name) for name in public.__all__})
    return globals()[name]


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
