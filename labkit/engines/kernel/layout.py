"""How contacts and grains lie in memory.

Vectors are computed in blocks of WIDTH contacts or grains. A block is a run of rows, one quantity per row, WIDTH
numbers each; the rows of a block follow one another, so that the compiler sees constant distances between them
and turns a loop over a block into vector instructions. What contacts read of grains, and what they give back,
goes through rows of one grain (a site): these lie together because contacts read them in no order.

What a scene leaves out is None where it would be passed, and Numba compiles the kernel without it.
"""

from __future__ import annotations

WIDTH = 64  # contacts or grains of a block
LANES = 8  # of them that a vector holds

# rows of a block of contacts: constants, then the history that the scene keeps
STIFFNESS, RADIUS_A, RADIUS_B, HISTORY = (row * WIDTH for row in range(4))

# rows of a block of grains
X, V, W, INVERSE_MASS, INVERSE_INERTIA = (row * WIDTH for row in (0, 3, 6, 9, 10))
GRAIN_ROWS = 11

# columns of a site: position, velocity, angular velocity; and of its force and torque; every fourth is unused, so that
# a vector of three lies in one line of the cache
SITE_X, SITE_V, SITE_W, SITE_COLUMNS = 0, 4, 8, 12
SITE_FORCE, SITE_TORQUE, FORCE_COLUMNS = 0, 4, 8

# rows of the workspace of the contacts of a domain: what is read of the sites, what is given back, sums of energy
D, VREL, WA, WB = (row * WIDTH for row in (0, 3, 6, 9))
FORCE, TORQUE_A, TORQUE_B = (row * WIDTH for row in (12, 15, 18))
CELL_WORK, FRICTION_LOSS, ROLLING_LOSS, DASHPOT_LOSS = (row * WIDTH for row in (21, 22, 23, 24))
# and of its grains: force and torque, sums of energy, largest speed
GRAIN_FORCE = 25 * WIDTH
DAMPING_LOSS, SPEED2 = (row * WIDTH for row in (31, 32))
WORK_ROWS = 33
