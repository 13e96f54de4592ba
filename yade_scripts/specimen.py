"""Preparation of a specimen in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/specimen.py --void-ratio 0.67 --side 2e-3 -o s.state.nc
yade-batch --log specimen.%.log yade_scripts/specimen.table yade_scripts/specimen.py
"""

import os
import sys

sys.path.append(os.path.dirname(os.path.abspath(sys.argv[0])))

import start_labkit

start_labkit.run_labkit("specimen")
