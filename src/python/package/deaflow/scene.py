"""Scenes, and simulations in them."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _deaflow
from .result import Result

PathLike = Union[str, "os.PathLike[str]"]


class Scene:
    """A device to simulate: geometry, material, drive and effects.

    Parameters
    ----------
    values : mapping
        The scene in the keys of a scene file, such as ``{"geometry": {"side": "50 mm", …}, …}``. It cannot name files:
        use `Scene.read`.

    Raises
    ------
    Error
        If a key is unknown or missing, or a value is invalid. The text has the place, and what is allowed.
    """

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._scene = _deaflow.Scene.of_text(_json(values))

    @classmethod
    def read(cls, path: PathLike, overrides: Optional[Mapping[str, Any]] = None) -> Scene:
        """Read a scene from a file of a scene, or of a pipeline that has one.

        Parameters
        ----------
        path : path
            The YAML file.
        overrides : mapping, optional
            Values to change, as by ``--set``: ``{"drive.voltage": "4 kV"}``. `None` removes a key.

        Raises
        ------
        Error
            If the file cannot be read, or a value is invalid.
        """
        sets = [f"{key}={_value(value)}" for key, value in (overrides or {}).items()]
        return cls._of(_deaflow.Scene.read(os.fspath(path), sets))

    @classmethod
    def _of(cls, scene: _deaflow.Scene) -> Scene:
        made = cls.__new__(cls)
        made._scene = scene
        return made

    @classmethod
    def _of_text(cls, text: str) -> Scene:
        return cls._of(_deaflow.Scene.of_text(text))

    def in_state(self, name: str) -> Scene:
        """Return the scene in one of its `states`."""
        return self._of(self._scene.in_state(name))

    @property
    def text(self) -> str:
        """The scene on one line of YAML, with all defaults, as in the attribute `scene` of files."""
        return self._scene.text

    @property
    def notes(self) -> list[str]:
        """What to know about how the scene was read, such as numbers without a unit."""
        return self._scene.notes

    @property
    def states(self) -> list[str]:
        """The names of the states of the device; empty if it has a single drive."""
        return self._scene.states

    @property
    def groups(self) -> int:
        """The number of electrode groups."""
        return self._scene.groups

    @property
    def shape(self) -> tuple[int, int]:
        """The numbers of rows and columns of cells, (ny, nx)."""
        return self._scene.shape

    @property
    def size(self) -> tuple[float, float]:
        """The sides of the membrane along x and y in mm."""
        width, height = self._scene.size
        return width, height

    def solve(
        self,
        patterns: ArrayLike,
        *,
        coverage: Optional[ArrayLike] = None,
        method: Optional[str] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        accuracy: Optional[str] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
        cells: bool = False,
        checks: bool = False,
    ) -> Result:
        """Find the equilibrium of each pattern, in each state of the scene.

        All cores are used and other threads of Python run meanwhile. Ctrl-C ends it.

        Parameters
        ----------
        patterns : array, (n, ny, nx) or (ny, nx)
            Integers or bools: the electrode group of each cell, 0 for a bare cell. Floats: the share of each cell that
            electrodes of group 1 cover, from 0 to 1. The first row is the lower edge of the membrane.
        coverage : array of float, of the same shape, optional
            The share of each cell that its electrode group covers, if the device has several groups.
        method : str, optional
            "newton" (default), or the estimates "linear" and "chord:N".
        elements_per_cell : int, optional
            Elements along one side of a cell, 1 to 8; 2 by default.
        order : int, optional
            Polynomial order of the elements, 1 (default) or 2.
        accuracy : str, optional
            A length such as "0.005 mm", instead of a mesh: each pattern is solved on a mesh that is this accurate.
        tolerance : float, optional
            Relative residual at which an equilibrium is accepted; 1e-8 by default.
        time_limit : str, optional
            Work limit of each pattern, such as "60 s".
        cells : bool
            Also return stretches, electric field and stresses of each cell, as ``--cells`` does.
        checks : bool
            Also check how much neglected effects would change the displacement: see `Result.warnings`. That can take
            longer than the solution.

        Returns
        -------
        Result
            The arrays that ``deaflow solve`` writes, with the same bits. A pattern without a stable solution has NaN,
            and its `outcome` says why.

        Raises
        ------
        Error
            If an array or an option is invalid, or the scene cannot be simulated with it.
        """
        groups, shares = _patterns(patterns, coverage)
        solver = _solver(method, elements_per_cell, order, accuracy, tolerance, time_limit)
        return Result(*self._scene.solve(groups, shares, solver, cells=cells, checks=checks))

    def value_and_gradient(
        self,
        patterns: ArrayLike,
        objective: Mapping[str, Any],
        *,
        coverage: Optional[ArrayLike] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> tuple[Any, NDArray[np.float64]]:
        """Compute an objective and its derivative with respect to the covered share of each cell.

        The derivative is exact for the mesh, by the adjoint method: it takes one more linear solution.

        Parameters
        ----------
        patterns, coverage, elements_per_cell, order, tolerance, time_limit
            As for `solve`.
        objective : mapping
            The objective of a `design` stage, such as ``{"point": ["25 mm", "25 mm"], "direction": "0 deg"}``.

        Returns
        -------
        value : ndarray of float64, (n,), or float
            For directions the displacement along them in mm, or the force of a side in mN; for targets the distance
            from them in mm. A float if `patterns` has two axes. NaN without a stable solution.
        gradient : ndarray of float64, the shape of `patterns`
            The derivative of the value with respect to the share that the electrode of each cell covers; of a bare
            cell, by an electrode at the largest voltage. 0 on frames and bodies, NaN without a stable solution. Among
            cells of equal shares other than 0 and 1 there is no derivative, as the edges that cut them have no
            direction.

        Raises
        ------
        Error
            If the objective is invalid, or the scene has no such derivative: effects that are not simulated where
            cells are covered in part, such as `wrinkling`.
        """
        groups, shares = _shares(patterns, coverage)
        solver = _solver(None, elements_per_cell, order, None, tolerance, time_limit)
        values, gradient = self._scene.value_and_gradient(groups, shares, _json(objective), solver)
        return (float(values[0]), gradient[0]) if np.ndim(patterns) == 2 else (values, gradient)

    def displacement_gradient(
        self,
        patterns: ArrayLike,
        weights: ArrayLike,
        *,
        coverage: Optional[ArrayLike] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> NDArray[np.float64]:
        """Compute the derivative of ``(weights * displacement).sum()`` with respect to the covered share of each cell.

        It is the product of a vector and the Jacobian that reverse differentiation needs: see `deaflow.torch` and
        `deaflow.jax`. The scene has one state: see `in_state`.

        Parameters
        ----------
        patterns, coverage, elements_per_cell, order, tolerance, time_limit
            As for `value_and_gradient`.
        weights : array of float, (n, ny + 1, nx + 1, 2) or (ny + 1, nx + 1, 2)
            A weight for each component of the displacement of each corner, per mm.

        Returns
        -------
        ndarray of float64, the shape of `patterns`
            NaN without a stable solution.
        """
        groups, shares = _shares(patterns, coverage)
        vectors = np.ascontiguousarray(weights, dtype=np.float64)
        vectors = vectors if vectors.ndim == 4 else vectors[np.newaxis]
        if vectors.ndim != 4:
            raise ValueError("weights have the axes (n, ny + 1, nx + 1, 2) or (ny + 1, nx + 1, 2)")
        solver = _solver(None, elements_per_cell, order, None, tolerance, time_limit)
        _, gradient = self._scene.weighted(groups, shares, vectors, solver)
        return gradient[0] if np.ndim(patterns) == 2 else gradient

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self.text == other.text

    def __hash__(self) -> int:
        return hash(self.text)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self)._of_text, (self.text,)

    def __repr__(self) -> str:
        return f"<deaflow scene {self.text}>"


def _patterns(
    patterns: ArrayLike, coverage: Optional[ArrayLike]
) -> tuple[NDArray[np.uint8], Optional[NDArray[np.float64]]]:
    """Return groups and shares with three axes."""
    array = _three_axes(np.asarray(patterns))
    if array.dtype.kind == "f":
        if coverage is not None:
            raise TypeError("floats are shares of group 1: give `coverage` beside integers")
        shares = np.ascontiguousarray(array, dtype=np.float64)
        return np.ones(shares.shape, dtype=np.uint8), shares
    if array.dtype.kind not in "bui":
        raise TypeError(f"patterns are integers, bools or floats, not {array.dtype}")
    if array.size and (array.min() < 0 or array.max() > 255):
        raise ValueError("an electrode group is from 0 to 255")
    groups = np.ascontiguousarray(array, dtype=np.uint8)
    if coverage is None:
        return groups, None
    return groups, np.ascontiguousarray(_three_axes(np.asarray(coverage)), dtype=np.float64)


def _shares(patterns: ArrayLike, coverage: Optional[ArrayLike]) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Return groups and shares with three axes; those of whole cells are 0 and 1."""
    groups, shares = _patterns(patterns, coverage)
    return groups, (groups > 0).astype(np.float64) if shares is None else shares


def _three_axes(array: NDArray[Any]) -> NDArray[Any]:
    if array.ndim not in (2, 3):
        raise ValueError(f"patterns have the axes (n, ny, nx) or (ny, nx), not {array.ndim} axes")
    return array if array.ndim == 3 else array[np.newaxis]


def _solver(
    method: Optional[str],
    elements_per_cell: Optional[int],
    order: Optional[int],
    accuracy: Optional[str],
    tolerance: Optional[float],
    time_limit: Optional[str],
) -> str:
    """Return the options in the keys of a solve stage."""
    options = {
        "method": method,
        "elements_per_cell": elements_per_cell,
        "order": order,
        "accuracy": accuracy,
        "tolerance": tolerance,
        "time_limit": time_limit,
    }
    return _json({key: value for key, value in options.items() if value is not None})


def _value(value: Any) -> str:
    """Return the value of an override in YAML; texts are YAML already, as on the command line."""
    return value if isinstance(value, str) else _json(value)


def _json(value: Any) -> str:
    """Return a value in JSON, which is YAML too."""
    return json.dumps(value, default=_plain, ensure_ascii=False)


def _plain(value: Any) -> Any:
    """Return what JSON knows for a number or an array of numpy, or a mapping."""
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r} has no form in YAML")
