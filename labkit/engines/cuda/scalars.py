"""Functions of numpy for one number, which replace numpy in `spring` and `pair_stiffness` of a contact law.

Both are also applied to arrays, elsewhere, and therefore call numpy; numba-cuda lacks some of its functions.
"""

from __future__ import annotations

import math

maximum, minimum, sqrt = max, min, math.sqrt
