"""Isotropic consolidation on YADE, by hand or from a table:

    yade -n -x yade_scripts/consolidate.py s.state.nc --pressure 0.5e6 -o s500.state.nc
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.cli import arguments  # noqa: E402
from labkit.cli import commands  # noqa: E402
from labkit.cli import yade_main  # noqa: E402

yade_main.main("consolidation", arguments.add_consolidation_options, commands.consolidation)
