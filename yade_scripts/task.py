"""Runs one labkit task in YADE; started by `labkit.run(..., engine="yade")` and by the command line.

yade -n -x yade_scripts/task.py task.json
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.cli import yade_main

yade_main.do_task(sys.argv[1])
