"""Memory layout of contacts and grains.

The kernel computes with blocks of WIDTH contacts or grains. A block consists of consecutive rows of WIDTH numbers, one
quantity per row, so that quantities are a constant stride apart and the compiler can vectorise a loop over a block.
The quantities of a grain that contacts read, and the forces that they return, are stored together in one record per
grain (its site), because contacts access grains in no particular order.

The kernel gets None for each feature that a scene does not use, and Numba compiles it without that feature.
"""

from __future__ import annotations

WIDTH = 64  # contacts or grains per block
LANES = 8  # numbers per vector register

# rows of a block of contacts: constants, then the history that the scene uses
STIFFNESS, RADIUS_A, RADIUS_B, HISTORY = (row * WIDTH for row in range(4))

# rows of a block of grains
X, V, W, INVERSE_MASS, INVERSE_INERTIA = (row * WIDTH for row in (0, 3, 6, 9, 10))
GRAIN_ROWS = 11

# columns of a site: position, velocity, angular velocity; and of its force and torque; every fourth is unused, so that
# a vector never crosses a cache line
SITE_X, SITE_V, SITE_W, SITE_COLUMNS = 0, 4, 8, 12
SITE_FORCE, SITE_TORQUE, FORCE_COLUMNS = 0, 4, 8

# rows of the workspace of a domain, for contacts: values read from sites, results for sites, energy sums
D, VREL, WA, WB = (row * WIDTH for row in (0, 3, 6, 9))
FORCE, TORQUE_A, TORQUE_B = (row * WIDTH for row in (12, 15, 18))
CELL_WORK, FRICTION_LOSS, ROLLING_LOSS, DASHPOT_LOSS = (row * WIDTH for row in (21, 22, 23, 24))
# and for grains: force and torque, energy sums, largest speed
GRAIN_FORCE = 25 * WIDTH
DAMPING_LOSS, SPEED2 = (row * WIDTH for row in (31, 32))
WORK_ROWS = 33
