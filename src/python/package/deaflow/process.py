"""The command line in processes of its own."""

from __future__ import annotations

import os
import site
import sys


def own_command() -> list[str]:
    """Return the words that start the command line of this package in a process of its own."""
    python = [sys.executable or "python3", "-m", "deaflow"]
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    if folder in (*site.getsitepackages(), site.getusersitepackages()):
        return python
    # The process has another `sys.path`.
    others = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = [folder, *(other for other in others if other not in ("", folder))]
    return ["env", f"PYTHONPATH={os.pathsep.join(paths)}", *python]
