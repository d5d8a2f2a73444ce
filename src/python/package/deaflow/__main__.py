"""The command `deaflow`, as `python -m deaflow`."""

import sys

from ._deaflow import main as run_command


def main() -> int:
    """Run the command line of this process and return its exit code."""
    return run_command(["deaflow", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
