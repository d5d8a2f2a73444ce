"""Draws deformed membranes with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Optional

import numpy as np
from numpy.typing import NDArray

from .arrays import Arrays, NotFound, needed

if TYPE_CHECKING:
    from .scene import Scene

# Bare cells, and the electrode groups in their order; with more groups the colours repeat.
BARE = "#e6e6e6"
GROUPS = ("#c0392b", "#2471a3", "#1e8449", "#b7950b", "#7d3c98", "#ca6f1e")


def plot(
    scene: Scene,
    result: Arrays,
    sample: int,
    state: Optional[str],
    time: int,
    point: Optional[Sequence[float]],
    axes: Optional[Any],
) -> Any:
    """Draw a sample: see `Scene.plot`."""
    needed("matplotlib")
    from matplotlib.collections import PolyCollection

    at = {"sample": sample, "state": _state(result, state), "time": time}
    displacement = _at(result, "displacement", at)
    corners = _corners(scene)
    if displacement.shape[:2] != corners.shape[:2]:
        rows, columns = displacement.shape[0] - 1, displacement.shape[1] - 1
        raise ValueError(f"the result has {columns} x {rows} cells, the scene {scene.shape[1]} x {scene.shape[0]}")
    planar = displacement[..., :2]
    if axes is None:
        import matplotlib.pyplot

        _, axes = matplotlib.pyplot.subplots()
    if np.isfinite(planar).all():
        moved = corners + planar
        squares = np.stack([moved[:-1, :-1], moved[:-1, 1:], moved[1:, 1:], moved[1:, :-1]], axis=2).reshape(-1, 4, 2)
        colours = _colours(result, at)
        # Lines of the colour of the cells, so that no gaps are seen between them.
        cells = PolyCollection(list(squares), facecolors=colours, edgecolors=colours, linewidths=0.3)
        axes.add_collection(cells)
        _point(axes, scene, displacement, point)
    width, height = scene.size
    axes.plot([0, width, width, 0, 0], [0, 0, height, height, 0], color="0.4", linewidth=0.7, linestyle="--")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("x, mm")
    axes.set_ylabel("y, mm")
    axes.set_title(_title(scene, result, at, displacement, point))
    return axes


def _state(result: Arrays, state: Optional[str]) -> int:
    """Return the position of a state; the first one by default."""
    states = result["states"].tolist() if "states" in result else []
    if state is None:
        return 0
    if state not in states:
        raise NotFound(f"the result has no state {state!r}" + (f"; there are: {', '.join(states)}" if states else ""))
    position: int = states.index(state)
    return position


def _at(result: Arrays, name: str, at: dict[str, int]) -> NDArray[Any]:
    """Return an array of one sample, in one state and at one time."""
    place = tuple(at[axis] for axis in result.dims[name] if axis in at)
    values: NDArray[Any] = result[name][place]
    return values


def _corners(scene: Scene) -> NDArray[np.float64]:
    """Return the corners of the cells at rest in mm, (ny + 1, nx + 1, 2)."""
    (rows, columns), (width, height) = scene.shape, scene.size
    x, y = np.meshgrid(np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1))
    return np.stack([x, y], axis=-1)


def _colours(result: Arrays, at: dict[str, int]) -> NDArray[np.float64]:
    """Return the colour of each cell; one that is covered in part has a mixture."""
    from matplotlib.colors import to_rgb

    is_cut = "covered/share" in result
    groups = _at(result, "covered/group" if is_cut else "patterns", at).ravel().astype(int)
    shares = _at(result, "covered/share", at).ravel() if is_cut else (groups > 0).astype(float)
    table = np.array([to_rgb(colour) for colour in GROUPS])
    of_groups, bare = table[(groups - 1) % len(GROUPS)], np.array(to_rgb(BARE))
    colours: NDArray[np.float64] = bare + shares[:, None] * (of_groups - bare)
    return colours


def _displacement_at(scene: Scene, displacement: NDArray[np.float64], point: Sequence[float]) -> NDArray[np.float64]:
    """Interpolate the displacement at a point of the membrane in mm, as ``--point`` does."""
    cell = np.array(scene.size) / np.array(scene.shape[::-1])
    last = np.array(scene.shape[::-1]) - 1
    place = np.asarray(point, dtype=np.float64) / cell
    if place.shape != (2,) or (place < 0).any() or (place > last + 1).any():
        width, height = scene.size
        raise ValueError(f"the point is outside the membrane: x is from 0 to {width} mm and y from 0 to {height} mm")
    column, row = np.minimum(place.astype(int), last)
    s, t = place - (column, row)
    below = (1 - s) * displacement[row, column] + s * displacement[row, column + 1]
    above = (1 - s) * displacement[row + 1, column] + s * displacement[row + 1, column + 1]
    between: NDArray[np.float64] = (1 - t) * below + t * above
    return between


def _point(axes: Any, scene: Scene, displacement: NDArray[np.float64], point: Optional[Sequence[float]]) -> None:
    """Draw where a point is at rest, and where it has moved."""
    if point is None:
        return
    moved = _displacement_at(scene, displacement, point)
    (x, y), (u, v) = point, moved[:2]
    axes.plot([x, x + u], [y, y + v], color="black", linewidth=1)
    axes.plot([x], [y], "o", color="black", fillstyle="none", markersize=4)
    axes.plot([x + u], [y + v], "o", color="black", markersize=4)


def _title(
    scene: Scene,
    result: Arrays,
    at: dict[str, int],
    displacement: NDArray[np.float64],
    point: Optional[Sequence[float]],
) -> str:
    """Return what is drawn, and on a second line the displacement of the point, or the largest one."""
    drawn = [f"pattern {range(result.shapes['displacement'][0])[at['sample']]}"]
    if "states" in result:
        drawn.append(f"state {result['states'][at['state']]}")
    if "time" in result.dims["displacement"]:
        drawn.append(f"t = {result['time'][at['time']]:g} s")
    outcome = str(_at(result, "outcome", at)) if "outcome" in result else "no stable solution"
    is_solved = np.isfinite(displacement).all()
    if not is_solved or outcome in ("estimated", "predicted"):
        drawn.append(outcome)
    first = ", ".join(drawn)
    if not is_solved:
        return first
    if point is None:
        return f"{first}\nlargest displacement {np.linalg.norm(displacement, axis=-1).max():.4g} mm"
    moved = zip("xyz", _displacement_at(scene, displacement, point))
    parts = ", ".join(f"{axis} {part:.4g} mm" for axis, part in moved)
    return f"{first}\ndisplacement of the point ({point[0]:g}, {point[1]:g}) mm: {parts}"
