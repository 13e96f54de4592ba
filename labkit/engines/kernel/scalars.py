"""Scalar versions of numpy's functions, which replace numpy in the functions that the engines compile.

The functions of the parts of a contact law are also applied to arrays and therefore call numpy. The scalar versions
compile to fewer instructions.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

maximum, minimum, sqrt = max, min, math.sqrt


def __getattr__(name: str) -> Any:
    return getattr(np, name)
