"""Functions of numpy for one number, which replace numpy in the `spring` of a contact law.

`spring` is also applied to arrays, elsewhere, and therefore calls numpy; numba-cuda lacks some of its functions.
"""

from __future__ import annotations

import math

maximum, minimum, sqrt = max, min, math.sqrt
