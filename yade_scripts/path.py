"""A loading path in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/path.py cv s.state.nc --strain 0.4 -o r.run.nc
yade-batch --log path.%.log yade_scripts/path.table yade_scripts/path.py
"""

import os
import sys

sys.path.append(os.path.dirname(os.path.abspath(sys.argv[0])))

import start_labkit

start_labkit.run_labkit("run", ["path", "specimen"])
