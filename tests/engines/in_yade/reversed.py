"""YADE may hold a contact as (b, a): here half of them are swapped before the state is read, and loaded again."""

import os
import sys

sys.path.append(os.path.join(sys.argv[1], "tests/engines/in_yade"))
import common
import numpy as np

from labkit.dem.state import read_state
from labkit.engines.yade import YadeEngine

state = read_state(common.words[0])
order = np.arange(state.number_of_grains)[::-1]  # grains in the other order turn every contact
back = np.argsort(order)
turned = state.replace(
    radius=state.radius[order],
    position=state.position[order],
    velocity=state.velocity[order],
    angular_velocity=state.angular_velocity[order],
    contact_grain=back[state.contact_grain].astype(np.int32),
)
found = YadeEngine(turned).state()
# found lists contacts by (smaller, larger) of the new numbers: bring both to the old numbers, first < second
pair = order[found.contact_grain]
swap = (pair[:, 0] > pair[:, 1])[:, None]
pair = np.sort(pair, axis=1)
sign = np.where(swap, -1.0, 1.0)
by = np.lexsort((pair[:, 1], pair[:, 0]))
force, moment = (sign * found.tangential_force)[by], (sign * found.rolling_moment)[by]
shift = np.where(swap, -found.contact_shift, found.contact_shift)[by]
assert np.array_equal(pair[by], state.contact_grain) and np.array_equal(shift, state.contact_shift)
difference = max(
    np.abs(force - state.tangential_force).max() / np.abs(state.tangential_force).max(),
    np.abs(moment - state.rolling_moment).max() / np.abs(state.rolling_moment).max(),
)
common.write({"turned": int((turned.contact_grain[:, 0] > turned.contact_grain[:, 1]).sum()), "difference": difference})
