"""`python -m benchmarks COMMAND`: the benchmarks, registered next to labkit's own commands."""

from __future__ import annotations

import sys

import benchmarks.command  # noqa: F401  registers them
from labkit.cli.dispatch import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
