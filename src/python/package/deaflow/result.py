"""The results of simulations."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Optional

import numpy as np
from numpy.typing import NDArray

from .arrays import Arrays, NotFound

if TYPE_CHECKING:
    from ._deaflow import Described


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

    def __init__(self, arrays: dict[str, Described], attributes: dict[str, str], warnings: list[str]) -> None:
        self.attributes = attributes
        self.warnings = warnings
        self._arrays = {path: values for path, (values, *_) in arrays.items()}
        self.shapes = {path: values.shape for path, values in self._arrays.items()}
        self.units = {path: units for path, (_, units, _, _) in arrays.items()}
        self.descriptions = {path: text for path, (_, _, text, _) in arrays.items()}
        self.dims = {path: tuple(axes) for path, (_, _, _, axes) in arrays.items()}

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._arrays[name]
        except KeyError:
            raise NotFound(f"the result has no array {name!r}; there are: {', '.join(self)}") from None

    @property
    def critical_voltage(self) -> Optional[NDArray[np.float64]]:
        """The voltages in V between which stability is lost, (n, 2).

        None unless the scene has the effect `electromechanical_stability`.
        """
        return self._arrays.get("critical_voltage")

    @property
    def error(self) -> Optional[NDArray[np.float64]]:
        """The estimated error of the displacement by the mesh in mm, (n,); None unless an `accuracy` was given."""
        return self._arrays.get("discretisation_error")

    def table(self) -> Any:
        """Return a `pandas.DataFrame` with a row for each pattern; see `Arrays.to_pandas`."""
        return self.to_pandas("sample")

    def __repr__(self) -> str:
        return "\n".join(["<deaflow result>", *self._lines()])
