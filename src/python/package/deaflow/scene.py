"""Scenes, and simulations in them."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _deaflow
from .arrays import Arrays
from .design import design
from .plot import plot
from .result import Result
from .values import to_json, to_value, with_unit

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
        self._scene = _deaflow.Scene.of_text(to_json(values))
        self._warn()

    def _warn(self) -> None:
        # As the command line does; the caller of the caller has written the scene.
        for note in self.notes:
            warnings.warn(note, stacklevel=3)

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
        sets = [f"{key}={to_value(value)}" for key, value in (overrides or {}).items()]
        made = cls._of(_deaflow.Scene.read(os.fspath(path), sets))
        made._warn()
        return made

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
        """What to know about how the scene was read, such as numbers without a unit: also Python warnings."""
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

        All cores are used and other threads of Python run meanwhile. Ctrl-C ends it. If the scene is under pressure, or
        its bodies move out of the plane, displacements have three components; the last one is the height.

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
        return Result(self._scene.solve(groups, shares, solver, cells=cells, checks=checks))

    def history(
        self,
        patterns: ArrayLike,
        *,
        at: Union[str, Sequence[float], NDArray[Any], None] = None,
        every: Union[str, float, None] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        accuracy: Optional[str] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> Result:
        """Simulate each pattern over the time of the drive, as ``deaflow solve --history`` does.

        The scene has one state: see `in_state`. Cells are not covered in part.

        Parameters
        ----------
        patterns : array of int or bool, (n, ny, nx) or (ny, nx)
            As for `solve`.
        at : str or sequence of float, optional
            The output times, such as ``"0 s, 1 s, 10 min"``, or numbers in s. 0 s is just after the start of the drive.
            By default 25 times up to the `duration` of the drive.
        every : str or float, optional
            The interval between output times, such as ``"10 s"``, or a number in s, instead of `at`.
        elements_per_cell, order, accuracy, tolerance, time_limit
            As for `solve`. An accuracy is that of the mesh and of the time steps.

        Returns
        -------
        Result
            Among others `time` in s, (nt,), `displacement` in mm, (n, nt, ny + 1, nx + 1, 2), and `max_displacement` in
            mm, (n, nt); NaN after stability is lost, and `outcome` says why.

        Raises
        ------
        Error
            As for `solve`; also if the scene cannot be simulated in time, or there is no end time.
        """
        groups, shares = _patterns(patterns, None)
        solver = _solver(None, elements_per_cell, order, accuracy, tolerance, time_limit)
        times = at if at is None or isinstance(at, str) else ", ".join(with_unit(time, "s") for time in at)
        interval = every if every is None else with_unit(every, "s")
        return Result(self._scene.history(groups, shares, solver, at=times, every=interval))

    def path(
        self,
        patterns: ArrayLike,
        parameter: str = "voltage",
        *,
        coverage: Optional[ArrayLike] = None,
        elements_per_cell: int = 1,
        order: int = 2,
        tolerance: Optional[float] = None,
    ) -> Result:
        """Follow each pattern from rest past the point where it loses stability, as ``deaflow solve --path`` does.

        Parameters
        ----------
        patterns, coverage, elements_per_cell, order, tolerance
            As for `solve`, but on one biquadratic element per cell by default: bilinear elements overestimate critical
            voltages.
        parameter : str
            What changes: "voltage" (default) from 0, whatever the voltage of the scene; or at that voltage the forces
            of the scene ("load"), the given displacements of its bars ("displacement"), the "pressure" or the "volume"
            of its loads, from 0 to those of the scene.

        Returns
        -------
        Result
            The points of all paths in a row: those of pattern k are the rows ``point_offsets[k]`` to
            ``point_offsets[k + 1]`` of `voltage` in V, `max_displacement` in mm, `stable` and others. Where stability
            is lost is in `limit_kind`, `limit_voltage` and `limit_error` in V, (n,). Of a scene under pressure the points
            have `pressure` in Pa, `volume` in ml and `height` in mm.

        Raises
        ------
        Error
            As for `solve`; also if there is no stable state at which a path could start.
        """
        groups, shares = _patterns(patterns, coverage)
        solver = _solver(None, elements_per_cell, order, None, tolerance, None)
        return Result(self._scene.path(groups, shares, solver, parameter=parameter))

    def modes(
        self,
        patterns: ArrayLike,
        count: int,
        *,
        lumped: bool = False,
        coverage: Optional[ArrayLike] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> Result:
        """Find the lowest natural frequencies of each pattern about its equilibrium, as ``deaflow solve --modes`` does.

        The scene has one state, see `in_state`, and a density.

        Parameters
        ----------
        patterns, coverage, elements_per_cell, order, tolerance, time_limit
            As for `solve`.
        count : int
            The number of frequencies in the plane, and of those out of it; 1 to 100.
        lumped : bool
            Whether the mass is lumped at the nodes.

        Returns
        -------
        Result
            Among others `frequencies` in Hz, (n, count), with `modes`, (n, count, ny + 1, nx + 1, 2), and
            `out_of_plane_frequencies` with `out_of_plane_modes`, (n, count, ny + 1, nx + 1). NaN without a stable
            equilibrium, and where the mesh has no more motions.

        Raises
        ------
        Error
            As for `solve`; also if the scene has no density.
        """
        groups, shares = _patterns(patterns, coverage)
        solver = _solver(None, elements_per_cell, order, None, tolerance, time_limit)
        return Result(self._scene.modes(groups, shares, solver, count=count, lumped=lumped))

    def response(
        self,
        patterns: ArrayLike,
        frequencies: Union[str, Sequence[float], NDArray[Any]],
        *,
        points: Optional[int] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> Result:
        """Find the response to a small alternating voltage about each equilibrium: ``deaflow solve --response``.

        The scene has one state: see `in_state`. Cells are not covered in part.

        Parameters
        ----------
        patterns : array of int or bool, (n, ny, nx) or (ny, nx)
            As for `solve`.
        frequencies : str or sequence of float
            The lowest and the highest frequency, such as ``"1 Hz:1 kHz"``; or frequencies in Hz.
        points : int, optional
            The number of frequencies between the lowest and the highest one, logarithmically spaced; 100 by default.
        elements_per_cell, order, tolerance, time_limit
            As for `solve`.

        Returns
        -------
        Result
            Among others `frequency` in Hz, (nf,), `response_real` and `response_imaginary` in mm/V, (n, nf, ny + 1,
            nx + 1, 2), and `amplitude` in mm/V and `phase` in degrees, (n, nf), of the corner that moves most.

        Raises
        ------
        Error
            As for `solve`; also if the drive has no voltage as bias.
        """
        groups, shares = _patterns(patterns, None)
        solver = _solver(None, elements_per_cell, order, None, tolerance, time_limit)
        if isinstance(frequencies, str):
            found = self._scene.response(groups, shares, solver, hertz=[], range=frequencies, points=points)
        elif points is not None:
            raise TypeError('`points` is for a range of frequencies, such as "1 Hz:1 kHz"')
        else:
            hertz = [float(frequency) for frequency in frequencies]
            found = self._scene.response(groups, shares, solver, hertz=hertz, range=None, points=None)
        return Result(found)

    def screen(
        self, patterns: Optional[ArrayLike] = None, *, time_limit: Optional[str] = None
    ) -> dict[str, Any]:
        """Compare the effects of the scene with their thresholds, as ``deaflow screen`` does.

        Parameters
        ----------
        patterns : array of int or bool, (n, ny, nx) or (ny, nx), optional
            The patterns to evaluate; by default extreme ones.
        time_limit : str, optional
            Work limit of each simulation, such as "60 s".

        Returns
        -------
        dict
            What ``deaflow screen --json`` prints: ``"effects"``, a list of dicts with `effect`, `quantity`, `number`,
            `threshold`, `called_for`, `status`, `change`, `cost` and others; ``"simulated"``, the names of the effects
            that are on; ``"warnings"``, a line for each significant effect that is off.

        Raises
        ------
        Error
            If a pattern is invalid, or the effects cannot be simulated.
        """
        groups = None
        if patterns is not None:
            groups, shares = _patterns(patterns, None)
            if shares is not None:
                raise TypeError("effects are compared on whole cells: patterns are integers or bools, not floats")
        solver = _solver(None, None, None, None, None, time_limit)
        found: dict[str, Any] = json.loads(self._scene.screen(groups, solver))
        return found

    def accuracy(
        self,
        patterns: Optional[ArrayLike] = None,
        *,
        target: Union[str, float, None] = None,
        methods: Optional[Sequence[Union[str, Mapping[str, Any]]]] = None,
        reference: Optional[Mapping[str, Any]] = None,
        models: Sequence[str] = (),
        store: Optional[PathLike] = None,
        count: int = 12,
        seed: int = 1,
    ) -> dict[str, Any]:
        """Measure error and time of methods and meshes, as ``deaflow accuracy`` does.

        The reference uses all cores, the methods one.

        Parameters
        ----------
        patterns : array of int or bool, (n, ny, nx) or (ny, nx), optional
            The patterns to measure on; by default `count` of each of twelve families, which are drawn with `seed`.
        target : str or float, optional
            Find the fastest setting with an error of at most this, such as ``"0.01 mm"``, or a number in mm.
        methods : sequence of str and mapping, optional
            The methods, such as ``["linear", "chord:1", {"elements_per_cell": 4, "order": 2}]``; by default the usual
            ones of the scene.
        reference : mapping, optional
            The keys of a ``solve`` stage; ``{"elements_per_cell": 8, "order": 2}`` by default. With
            ``"history": {"at": ["10 s"]}`` the states at that time are compared.
        models : sequence of str, optional
            Trained networks to measure too, each named as for `Model.read`.
        store : path, optional
            The folder of the store with the networks; by default that of the command.

        Returns
        -------
        dict
            What ``deaflow accuracy --json`` prints, without files: ``"methods"``, a list of dicts with `settings`,
            `rms_mm`, `max_mm`, `bound_mm`, `seconds_per_pattern`, `front` and others; ``"reference"`` with its
            `error_mm`; ``"target"`` with the `settings` that reach it.

        Raises
        ------
        Error
            If a method or a pattern is invalid, or a method is not coarser than the reference.
        """
        groups = None
        if patterns is not None:
            groups, shares = _patterns(patterns, None)
            if shares is not None:
                raise TypeError("accuracy is measured on whole cells: patterns are integers or bools, not floats")
        found: dict[str, Any] = json.loads(
            self._scene.accuracy(
                groups,
                reference=None if reference is None else to_json(reference),
                methods=None if methods is None else to_json(list(methods)),
                target=None if target is None else with_unit(target, "mm"),
                networks=(list(models), None if store is None else os.fspath(store)),
                families=(count, seed),
            )
        )
        return found

    def value_and_gradient(
        self,
        patterns: ArrayLike,
        objective: Mapping[str, Any],
        *,
        wrt: Union[str, Sequence[str]] = "coverage",
        coverage: Optional[ArrayLike] = None,
        elements_per_cell: Optional[int] = None,
        order: Optional[int] = None,
        tolerance: Optional[float] = None,
        time_limit: Optional[str] = None,
    ) -> tuple[Any, Any]:
        """Compute an objective and its derivative with respect to the covered share of each cell, or to parameters.

        The derivative is exact for the mesh, by the adjoint method: it takes one more linear solution.

        Parameters
        ----------
        patterns, coverage, elements_per_cell, order, tolerance, time_limit
            As for `solve`.
        objective : mapping
            The objective of a `design` stage, such as ``{"point": ["25 mm", "25 mm"], "direction": "0 deg"}``.
        wrt : str or sequence of str
            "coverage" (default); or some of "voltage", "shear_modulus", "relative_permittivity" and "thickness", for
            patterns of whole cells. The last three are for membranes whose sides are held, without other forces, and
            "voltage" for effects on which it has no other influence.

        Returns
        -------
        value : ndarray of float64, (n,), or float
            For directions the displacement along them in mm, or the force of a side in mN; for targets the distance
            from them in mm. A float if `patterns` has two axes. NaN without a stable solution.
        gradient : ndarray of float64, the shape of `patterns`
            The derivative of the value with respect to the share that the electrode of each cell covers; of a bare
            cell, by an electrode at the largest voltage. 0 on frames and bodies, NaN without a stable solution. Among
            cells of equal shares other than 0 and 1 there is no derivative, as the edges that cut them have no
            direction. For another `wrt` a dict of ndarray by its names: of (n,), or of floats if `patterns` has two
            axes, in the unit of the value per V, per Pa, per 1 and per mm. Of "voltage" there is an axis more for the
            `states` if the scene has some, in their order, and one for its electrode groups if it has several.

        Raises
        ------
        Error
            If the objective is invalid, or the scene has no such derivative: effects that are not simulated where
            cells are covered in part, such as `wrinkling`.
        """
        solver = _solver(None, elements_per_cell, order, None, tolerance, time_limit)
        if wrt != "coverage":
            if coverage is not None:
                raise TypeError('`coverage` is for `wrt="coverage"`: other derivatives are those of whole cells')
            names = [wrt] if isinstance(wrt, str) else list(wrt)
            return self._derivatives(patterns, to_json(objective), solver, names)
        groups, shares = _shares(patterns, coverage)
        values, gradient = self._scene.value_and_gradient(groups, shares, to_json(objective), solver)
        return (float(values[0]), gradient[0]) if np.ndim(patterns) == 2 else (values, gradient)

    def _derivatives(
        self, patterns: ArrayLike, objective: str, solver: str, names: list[str]
    ) -> tuple[Any, dict[str, Any]]:
        groups, shares = _patterns(patterns, None)
        if shares is not None:
            raise TypeError("derivatives with respect to parameters are those of whole cells: integers or bools")
        parameters = [name for name in names if name != "coverage"]
        if "coverage" in names:
            _, shares = _shares(patterns, None)
        values, derivatives = self._scene.value_and_derivatives(groups, shares, objective, solver, parameters)
        found: dict[str, Any] = {}
        for name, each in zip([*parameters, "coverage"], derivatives):
            if name == "voltage":
                # Axes of the states and of the electrode groups are left out where there is one.
                each = each if self.states else each[:, 0]
                each = each if self.groups > 1 else each[..., 0]
            found[name] = each[0] if np.ndim(patterns) == 2 else each
        return (float(values[0]) if np.ndim(patterns) == 2 else values), found

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

    def design(
        self,
        objective: Mapping[str, Any],
        *,
        area: Union[float, str, None] = None,
        method: Optional[str] = None,
        constraints: Optional[Mapping[str, Any]] = None,
        seed: int = 1,
        store: Optional[PathLike] = None,
        jobs: Optional[int] = None,
        callback: Optional[Callable[[str], object]] = None,
        **options: Any,
    ) -> Result:
        """Search for patterns that reach an objective, as a stage of kind `design` does; needs h5py.

        The search is a process of its own, with the bits of ``deaflow run``. Ctrl-C stops it.

        Parameters
        ----------
        objective : mapping
            Such as ``{"point": ["25 mm", "25 mm"], "direction": "0 deg"}``.
        area : float or str, optional
            The share of the free membrane that electrodes cover, such as 0.5, or "free".
        method : str, optional
            "ga", the genetic algorithm (default), or "adjoint", the search along the gradient.
        constraints : mapping, optional
            Such as ``{"min_feature": "2 mm"}``.
        seed : int
            The seed of the random numbers.
        store : path, optional
            A folder that keeps the result and unfinished searches; by default a temporary one.
        jobs : int, optional
            Number of threads.
        callback : callable, optional
            Is called with a line for each generation and each step along the gradient, such as
            ``"gradient step 3: 2.147 mm at area 50.0 %"``. An exception in it stops the search.
        **options
            The other keys of the stage, such as ``population=200``, ``generations=20``, ``refine=True``, ``starts=3``.

        Returns
        -------
        Result
            The arrays of the stage: among others `patterns`, (n, ny, nx), with their `role`, (n,): the designs before
            the intuitive patterns that they are compared with; `value` in mm and `status`, (n,); `history/value` in mm
            of each generation, and `climb/value` in mm of the steps along the gradient.

        Raises
        ------
        Error
            If the objective or an option is invalid, or there is no such design.
        """
        given = {"area": area, "method": method, "constraints": constraints, "seed": seed, **options}
        keys = {key: value for key, value in given.items() if value is not None}
        return design(self.text, {"objective": objective, **keys}, store, jobs, callback)

    def plot(
        self,
        result: Arrays,
        sample: int = 0,
        *,
        state: Optional[str] = None,
        time: int = -1,
        point: Optional[Sequence[float]] = None,
        axes: Optional[Any] = None,
    ) -> Any:
        """Draw the deformed membrane with its electrodes; needs matplotlib.

        Parameters
        ----------
        result : Result or Artifact
            Displacements in this scene: of `solve`, `history` or `Model.predict`, or an artifact with them.
        sample : int
            The position of the pattern.
        state : str, optional
            A state of the device; the first one by default.
        time : int
            The position of the time of a history; the last one by default.
        point : pair of float, optional
            A point of the membrane in mm from its lower left corner: its motion is drawn, and told in the title.
        axes : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.

        Returns
        -------
        matplotlib.axes.Axes
            In mm, with the outline of the membrane at rest.

        Raises
        ------
        ImportError
            If matplotlib is not installed.
        ValueError
            If the result is not one of this scene, or the point is outside the membrane.
        """
        return plot(self, result, sample, state, time, point, axes)

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
    if coverage is None and array.dtype == np.uint8 and array.flags.c_contiguous:
        # In a loop over patterns the checks below take as long as all else.
        return array, None
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


def _solver(*options: Any) -> str:
    """Return the options in the keys of a solve stage: see `_solver_text`."""
    try:
        return _known_solver_text(*options)
    except TypeError:
        # One of them cannot be looked up. If it has no text either, that is said here.
        return _solver_text(*options)


def _solver_text(
    method: Optional[str],
    elements_per_cell: Optional[int],
    order: Optional[int],
    accuracy: Optional[str],
    tolerance: Optional[float],
    time_limit: Optional[str],
) -> str:
    options = {
        "method": method,
        "elements_per_cell": elements_per_cell,
        "order": order,
        "accuracy": accuracy,
        "tolerance": tolerance,
        "time_limit": time_limit,
    }
    return to_json({key: value for key, value in options.items() if value is not None})


# In a loop over patterns the options are the same.
_known_solver_text = lru_cache(maxsize=64, typed=True)(_solver_text)
