"""`python -m benchmarks COMMAND`: the benchmarks, registered next to labkit's own commands."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence

from labkit.cli.dispatch import main as run_command


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a benchmark, with the error messages and exit codes of labkit's commands."""
    importlib.import_module("benchmarks.command")  # registers them
    return run_command(list(sys.argv[1:] if argv is None else argv))


if __name__ == "__main__":
    sys.exit(main())
