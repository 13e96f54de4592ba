"""Contacts that YADE stores as (b, a): loads a state with its grains in reverse order, and compares what YADE holds."""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np

from labkit.dem.state import read_state
from labkit.engines.yade import YadeEngine

state = read_state(common.arguments[0])
order = np.arange(state.number_of_grains)[::-1]  # the reverse order of grains reverses every contact
back = np.argsort(order)
reversed_state = state.replace(
    radius=state.radius[order],
    position=state.position[order],
    velocity=state.velocity[order],
    angular_velocity=state.angular_velocity[order],
    contact_grain=back[state.contact_grain].astype(np.int32),
)
result = YadeEngine(reversed_state).state()
# `result` sorts contacts by their new indices (smaller, larger): convert to the old indices with first < second
pair = order[result.contact_grain]
swap = (pair[:, 0] > pair[:, 1])[:, None]
pair = np.sort(pair, axis=1)
sign = np.where(swap, -1.0, 1.0)
by = np.lexsort((pair[:, 1], pair[:, 0]))
force, moment = (sign * result.tangential_force)[by], (sign * result.rolling_moment)[by]
shift = np.where(swap, -result.contact_shift, result.contact_shift)[by]
assert np.array_equal(pair[by], state.contact_grain) and np.array_equal(shift, state.contact_shift)
difference = max(
    np.abs(force - state.tangential_force).max() / np.abs(state.tangential_force).max(),
    np.abs(moment - state.rolling_moment).max() / np.abs(state.rolling_moment).max(),
)
pair = reversed_state.contact_grain
common.write({"reversed": int((pair[:, 0] > pair[:, 1]).sum()), "difference": difference})
