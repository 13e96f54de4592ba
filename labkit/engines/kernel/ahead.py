"""Compiles the functions that all contact laws share, while another process compiles the functions of a law.

    python -P -m labkit.engines.kernel.ahead SINGLE ENERGY DAMPED CLUMPS

Each argument is True or False (labkit.engines.kernel.blocks.Needs). The only output is files with machine code.
"""

from __future__ import annotations

import sys
from typing import Any

from labkit.engines.kernel.blocks import Needs, shared_functions
from labkit.engines.kernel.machine import address_of

NO_LAW: Any = None

if __name__ == "__main__":
    for function in shared_functions(Needs(NO_LAW, NO_LAW, *(word == "True" for word in sys.argv[1:]))):
        address_of(*function)
