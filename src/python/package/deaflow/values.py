"""Values of Python in the texts that the command reads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Union


def with_unit(value: Union[str, float], unit: str) -> str:
    """Return a quantity; numbers have the unit."""
    return value if isinstance(value, str) else f"{float(value)!r} {unit}"


def to_value(value: Any) -> str:
    """Return the value of an override in YAML; texts are YAML already, as on the command line."""
    return value if isinstance(value, str) else to_json(value)


def to_json(value: Any) -> str:
    """Return a value in JSON, which is YAML too."""
    return json.dumps(value, default=_plain, ensure_ascii=False)


def _plain(value: Any) -> Any:
    """Return what JSON knows for a number or an array of numpy, or a mapping."""
    if isinstance(value, Mapping):
        return dict(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"{value!r} has no form in YAML")
