"""Measures the speed of labkit's YADE engine in a CV test and the cost of a record; run by `labkit bench`.

yade -n -x yade_scripts/speed.py s.state.nc 500
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.engines.speed import print_speed

print_speed("yade", sys.argv[1], int(sys.argv[2]), O.numThreads)
