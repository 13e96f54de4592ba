"""Functions of numpy for one number; they replace numpy in the `spring` of a contact law, because numba-cuda lacks some.

`spring` is also applied to arrays, elsewhere, and therefore calls numpy.
"""

from __future__ import annotations

import math

maximum, minimum, sqrt = max, min, math.sqrt
