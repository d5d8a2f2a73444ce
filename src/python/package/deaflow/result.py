"""The results of simulations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional

import numpy as np
from numpy.typing import NDArray

from .arrays import Arrays, NotFound

if TYPE_CHECKING:
    from ._deaflow import Found

# An array with its unit, description and the names of its axes; the same with its shape alone.
Described = tuple[NDArray[Any], str, str, list[str]]
About = tuple[list[int], str, str, list[str]]


class Result(Arrays):
    """What `Scene.solve` found: the arrays of the file that ``deaflow solve -o`` writes, by the same names.

    `Scene.history`, `Scene.path`, `Scene.modes` and `Scene.response` return the arrays of their own files.

    Attributes
    ----------
    patterns : ndarray of uint8, (n, ny, nx)
        The electrode group of each cell.
    displacement : ndarray of float64, (n, ny + 1, nx + 1, 2)
        Displacement of the cell corners in mm; NaN without a stable solution. If the scene has states, this and the
        other arrays have an axis of the states after the first one.
    outcome : ndarray of str, (n,)
        How each simulation ended: "converged", "pull-in", …
    max_displacement : ndarray of float64, (n,)
        The largest displacement in mm.
    warnings : list of str
        Warnings about the model, such as neglected effects; `checks=True` finds more.

    All others are listed by ``print(result)``, and explained by ``result.descriptions``.
    """

    warnings: list[str]

    def __init__(self, found: Found) -> None:
        # Arrays and texts are asked for when they are used: see `Found` in Rust.
        self._found: Optional[Found] = found
        self._arrays: dict[str, NDArray[Any]] = {}

    @classmethod
    def _of(cls, arrays: dict[str, Described], attributes: dict[str, str], warnings: list[str]) -> Result:
        """Return a result with arrays of numpy, each with its unit, description and the names of its axes."""
        made = cls.__new__(cls)
        made._found, made._arrays = None, {path: values for path, (values, *_) in arrays.items()}
        about = {path: (list(values.shape), units, text, axes) for path, (values, units, text, axes) in arrays.items()}
        made._describe(about, attributes, warnings)
        return made

    def _describe(self, about: dict[str, About], attributes: dict[str, str], warnings: list[str]) -> None:
        self.attributes, self.warnings = attributes, warnings
        self.shapes = {path: tuple(shape) for path, (shape, *_) in about.items()}
        self.units = {path: units for path, (_, units, _, _) in about.items()}
        self.descriptions = {path: text for path, (_, _, text, _) in about.items()}
        self.dims = {path: tuple(axes) for path, (_, _, _, axes) in about.items()}

    def __getattr__(self, name: str) -> Any:
        found = self.__dict__.get("_found")
        if found is None or "shapes" in self.__dict__:
            return super().__getattr__(name)
        self._describe(found.about, found.attributes, found.warnings)
        return getattr(self, name)

    def __getitem__(self, name: str) -> NDArray[Any]:
        if name in self._arrays:
            return self._arrays[name]
        values = None if self._found is None else self._found.array(name)
        if values is None:
            raise NotFound(f"the result has no array {name!r}; there are: {', '.join(self)}")
        self._arrays[name] = values
        return values

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = {path: (self[path], self.units[path], self.descriptions[path], list(self.dims[path])) for path in self}
        return type(self)._of, (arrays, self.attributes, self.warnings)

    @property
    def critical_voltage(self) -> Optional[NDArray[np.float64]]:
        """The voltages in V between which stability is lost, (n, 2).

        None unless the scene has the effect `electromechanical_stability`.
        """
        return self.get("critical_voltage")

    @property
    def error(self) -> Optional[NDArray[np.float64]]:
        """The estimated error of the displacement by the mesh in mm, (n,); None unless an `accuracy` was given."""
        return self.get("discretisation_error")

    def table(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each pattern; see `Arrays.to_pandas`."""
        return self.to_pandas("sample")

    def __repr__(self) -> str:
        return "\n".join(["<deaflow result>", *self._lines()])
