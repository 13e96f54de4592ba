"""The stratified layer of Fig. 3 in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/stratified.py --size-ratio 2 -o stratified.state.nc
"""

import os
import sys

sys.path.append(os.path.dirname(os.path.abspath(sys.argv[0])))

import start_labkit

start_labkit.run_labkit("stratified")
