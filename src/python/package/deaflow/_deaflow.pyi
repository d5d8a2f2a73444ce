"""The compiled part of deaflow."""

from typing import Any, Optional, final

import numpy as np
from numpy.typing import NDArray

__version__: str

@final
class Found:
    @property
    def about(self) -> dict[str, tuple[list[int], str, str, list[str]]]: ...
    @property
    def attributes(self) -> dict[str, str]: ...
    @property
    def warnings(self) -> list[str]: ...
    def array(self, path: str) -> Optional[NDArray[Any]]: ...

class Error(Exception):
    """An error of deaflow, with the text that the command prints."""

    code: int
    message: str
    help: Optional[str]
    file: Optional[str]
    line: Optional[int]
    column: Optional[int]

@final
class Scene:
    @staticmethod
    def read(path: str, sets: list[str]) -> Scene: ...
    @staticmethod
    def of_text(text: str) -> Scene: ...
    def in_state(self, name: str) -> Scene: ...
    @property
    def text(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def states(self) -> list[str]: ...
    @property
    def groups(self) -> int: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    @property
    def size(self) -> list[float]: ...
    def solve(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        solver: str,
        *,
        cells: bool,
        checks: bool,
    ) -> Found: ...
    def history(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        solver: str,
        *,
        at: Optional[str],
        every: Optional[str],
    ) -> Found: ...
    def path(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        solver: str,
        *,
        parameter: str,
    ) -> Found: ...
    def modes(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        solver: str,
        *,
        count: int,
        lumped: bool,
    ) -> Found: ...
    def response(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        solver: str,
        *,
        hertz: list[float],
        range: Optional[str],
        points: Optional[int],
    ) -> Found: ...
    def accuracy(
        self,
        groups: Optional[NDArray[np.uint8]],
        *,
        reference: Optional[str],
        methods: Optional[str],
        target: Optional[str],
        networks: tuple[list[str], Optional[str]],
        families: tuple[int, int],
    ) -> str: ...
    def screen(self, groups: Optional[NDArray[np.uint8]], solver: str) -> str: ...
    def value_and_gradient(
        self,
        groups: NDArray[np.uint8],
        shares: NDArray[np.float64],
        objective_text: str,
        solver: str,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...
    def value_and_derivatives(
        self,
        groups: NDArray[np.uint8],
        shares: Optional[NDArray[np.float64]],
        objective_text: str,
        solver: str,
        parameters: list[str],
    ) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]: ...
    def weighted(
        self,
        groups: NDArray[np.uint8],
        shares: NDArray[np.float64],
        weights: NDArray[np.float64],
        solver: str,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]: ...

@final
class Model:
    @staticmethod
    def read(name: str, calibration: Optional[str], store: Optional[str]) -> Model: ...
    @property
    def scene(self) -> Optional[str]: ...
    @property
    def network(self) -> str: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def check_scene(self, text: str) -> None: ...
    def predict(self, groups: NDArray[np.uint8], objectives: list[str]) -> Found: ...

def main(arguments: list[str]) -> int: ...
