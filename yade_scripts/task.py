"""One task of labkit in YADE: what `labkit.run(..., engine="yade")` and the command line start.

yade -n -x yade_scripts/task.py task.json
"""

import os
import sys

sys.path.append(os.environ.get("LABKIT_ROOT") or os.path.dirname(os.path.dirname(os.path.abspath(sys.argv[0]))))

from labkit.cli import yade_main

yade_main.do_task(sys.argv[1])
