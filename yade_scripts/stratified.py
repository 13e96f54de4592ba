"""The stratified layer of Fig. 3 in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/stratified.py --size-ratio 2 -o stratified.state.nc
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.cli import simulate, yade_main

yade_main.main(simulate.layer_options, simulate.stratified)
