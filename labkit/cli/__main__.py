"""`python -m labkit.cli`."""

from __future__ import annotations

import sys

from labkit.cli import program

sys.exit(program())
