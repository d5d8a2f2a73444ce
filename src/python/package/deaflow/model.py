"""Trained models, and their predictions."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Optional, Union

from numpy.typing import ArrayLike

from . import _deaflow
from .result import Result
from .scene import Scene, _patterns
from .values import to_json

PathLike = Union[str, "os.PathLike[str]"]


class Model:
    """A network that a stage of kind `train` has trained: see `Model.read`."""

    _model: _deaflow.Model

    def __init__(self) -> None:
        raise TypeError("a model is read with `Model.read`")

    @classmethod
    def read(
        cls, name: PathLike, *, calibration: Optional[PathLike] = None, store: Optional[PathLike] = None
    ) -> Model:
        """Read a model from a store or a file, as ``deaflow predict`` does.

        Parameters
        ----------
        name : str
            A stage of the last run, ``"pipeline.yaml:stage"``, a digest or its first digits, or a file.
        calibration : str, optional
            The result of a stage of kind `calibrate`, named like a model; for a model in the store by default the
            calibration of the last run.
        store : path, optional
            The folder of the store; by default that of the command.

        Raises
        ------
        Error
            If there is no such model, or it cannot be read.
        """
        made = cls.__new__(cls)
        named = None if calibration is None else os.fspath(calibration)
        made._model = _deaflow.Model.read(os.fspath(name), named, None if store is None else os.fspath(store))
        return made

    @property
    def scene(self) -> Optional[str]:
        """The scene that it was trained for, on one line of YAML; None if the file does not say."""
        return self._model.scene

    @property
    def network(self) -> str:
        """The kind of the network, such as "cnn"."""
        return self._model.network

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns of cells of its patterns, (ny, nx)."""
        return self._model.shape

    def predict(
        self,
        patterns: ArrayLike,
        *,
        objectives: Sequence[Mapping[str, Any]] = (),
        scene: Optional[Scene] = None,
    ) -> Result:
        """Predict the displacement of each pattern.

        Parameters
        ----------
        patterns : array of int or bool, (n, ny, nx) or (ny, nx)
            The electrode group of each cell, 0 for a bare cell. The first row is the lower edge of the membrane.
        objectives : sequence of mapping, optional
            Displacements whose intervals are wanted, such as ``[{"point": ["25 mm", "25 mm"], "direction": "0 deg"}]``;
            they need a calibration.
        scene : Scene, optional
            Refuse a model that was trained for another scene.

        Returns
        -------
        Result
            The arrays that ``deaflow predict`` writes, with the same bits: among others `displacement` in mm,
            (n, ny + 1, nx + 1, 2), and `max_displacement` in mm, (n,). With a calibration also ``interval/radius`` in mm,
            (n,): each component of the displacement at each corner is within it for the share of patterns in the
            attribute `coverage`; ``interval/out_of_distribution`` is 1 where that does not hold.

        Raises
        ------
        Error
            If a pattern is not one of the model, the model is not one of the scene, or an objective cannot be used.
        """
        if scene is not None:
            self._model.check_scene(scene.text)
        groups, shares = _patterns(patterns, None)
        if shares is not None:
            raise TypeError("a model predicts whole cells: patterns are integers or bools, not floats")
        return Result(self._model.predict(groups, [to_json(objective) for objective in objectives]))

    def __repr__(self) -> str:
        rows, columns = self.shape
        return f"<deaflow model {self.network} of {columns} x {rows} cells>"
