"""Isotropic consolidation of a specimen in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/consolidate.py s.state.nc --pressure 0.5e6 -o s500.state.nc
"""

import os
import sys

sys.path.append(os.path.dirname(os.path.abspath(sys.argv[0])))

import start_labkit

start_labkit.run_labkit("consolidate", ["specimen"])
