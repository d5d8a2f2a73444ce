"""Named arrays with units, descriptions and axes: artifacts of a store and results of simulations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Optional

import numpy as np
from numpy.typing import NDArray

__all__ = ["Arrays", "NotFound"]

# Arrays with more values per row are left out of tables.
MOST_COLUMNS = 16


class NotFound(KeyError):
    """No run, stage, artifact or array has the given name."""

    def __str__(self) -> str:
        # That of KeyError is the message in quotes.
        return str(self.args[0]) if self.args else ""


class Arrays(Mapping[str, NDArray[Any]]):
    """Arrays by path, such as ``arrays["displacement"]`` or ``arrays["cells/stretches"]``.

    An array whose path is a name is an attribute too: ``arrays.displacement``.

    Attributes
    ----------
    units : dict of str
        The unit of each array; "1" for pure numbers.
    descriptions : dict of str
        A sentence about each array.
    dims : dict of tuple of str
        The names of the axes of each array, slowest first.
    shapes : dict of tuple of int
        The shape of each array.
    attributes : dict of str
        Texts that belong to the arrays: scene, solver, effects.
    """

    units: dict[str, str]
    descriptions: dict[str, str]
    dims: dict[str, tuple[str, ...]]
    shapes: dict[str, tuple[int, ...]]
    attributes: dict[str, str]

    def _name(self) -> str:
        return "the result"

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self.shapes))

    def __len__(self) -> int:
        return len(self.shapes)

    def __getattr__(self, name: str) -> NDArray[Any]:
        # Before an object is filled, as when it is unpickled, it has no shapes.
        if name in self.__dict__.get("shapes", ()):
            return self[name]
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *(name for name in self if name.isidentifier())})

    def _lines(self) -> list[str]:
        lines = []
        for name in self:
            axes = ", ".join(f"{axis}: {n}" for axis, n in zip(self.dims[name], self.shapes[name]))
            unit = f" {self.units[name]}" if self.units[name] not in ("", "1") else ""
            lines.append(f"  {name} ({axes}){unit}")
        return lines

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` with named dimensions; units and descriptions are attributes of its variables."""
        xarray = needed("xarray")
        lengths: dict[str, int] = {}
        variables = {}
        for name in self:
            dims = []
            for axis, n in zip(self.dims[name], self.shapes[name]):
                # A Dataset allows only one length per axis name.
                dims.append(axis if lengths.setdefault(axis, n) == n else f"{axis}_{n}")
            about = {"units": self.units[name], "description": self.descriptions[name]}
            variables[name] = (dims, self[name], about)
        return xarray.Dataset(variables, attrs=self._about())

    def _about(self) -> dict[str, str]:
        return dict(self.attributes)

    def to_pandas(self, along: Optional[str] = None) -> Any:
        """Return a `pandas.DataFrame` with one row per index of an axis.

        Parameters
        ----------
        along : str, optional
            The axis; by default that of most one-dimensional arrays.

        Returns
        -------
        pandas.DataFrame
            Columns are those of ``deaflow show --csv``, without units in their names; ``frame.attrs["units"]`` has the
            units.
        """
        pandas = needed("pandas")
        axis = along if along is not None else self._main_axis()
        lengths = [self.shapes[name][0] for name in self if self.dims[name][:1] == (axis,)]
        if not lengths:
            known = sorted({dims[0] for dims in self.dims.values() if dims})
            raise NotFound(f"no array of {self._name()} has the axis {axis!r}: there are {', '.join(known)}")
        columns: dict[str, NDArray[Any]] = {}
        units: dict[str, str] = {}
        for name in self:
            first = self.dims[name][0] if self.dims[name] else ""
            is_same = first == axis or first.endswith(f"_{axis}")
            shape = self.shapes[name]
            if not is_same or shape[0] != lengths[0] or int(np.prod(shape[1:])) > MOST_COLUMNS:
                continue
            values = self[name]
            for place in np.ndindex(*shape[1:]):
                column = ".".join([name, *(self._step(name, k, at) for k, at in enumerate(place, 1))])
                columns[column], units[column] = values[(slice(None), *place)], self.units[name]
        frame = pandas.DataFrame(columns)
        frame.index.name = axis
        frame.attrs = {"units": units}
        return frame

    def _main_axis(self) -> str:
        firsts = [self.dims[name][0] for name in self if len(self.shapes[name]) == 1]
        return max(firsts, key=firsts.count, default="")

    def _step(self, name: str, axis: int, at: int) -> str:
        is_vector = self.dims[name][axis] == "xy" and self.shapes[name][axis] == 2
        return "xy"[at] if is_vector else str(at)


def needed(package: str) -> Any:
    """Return a package that is not installed with deaflow."""
    try:
        return __import__(package)
    except ImportError as error:
        raise ImportError(f"this needs {package}: pip install {package}") from error
