"""A loading path in YADE, as a single run or from a yade-batch table.

yade -n -x yade_scripts/path.py cv s.state.nc --strain 0.4 -o r.run.nc
yade-batch --log %.log yade_scripts/path.table yade_scripts/path.py
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.cli import simulate, yade_main

yade_main.main(simulate.run_options, simulate.run)
