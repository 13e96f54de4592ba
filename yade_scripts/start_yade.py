"""Starts YADE's main program without the two servers that it would open to the network: `start_yade.py YADE WORDS...`.

The main program offers a Python prompt (port 9000, which executes what it receives) and an information service (21000)
to every computer that can reach this one. labkit talks to YADE over a socket of its own and needs neither, so the
module that opens them is replaced. This file runs in YADE's Python, without labkit.
"""

import contextlib
import os
import sys
from importlib.machinery import ModuleSpec


class NoServers:
    """Finds and loads the module yade.remote, with nothing in it but a function that opens nothing."""

    @staticmethod
    def find_spec(name, path=None, target=None):
        """Return the specification of yade.remote, None for another module."""
        return ModuleSpec(name, NoServers) if name == "yade.remote" else None

    @staticmethod
    def create_module(spec):
        """Leave the creation of the module to Python."""

    @staticmethod
    def exec_module(module):
        """Fill the module."""
        module.runServers = remove_folder


def remove_folder():
    """Remove the folder that YADE makes for temporary files when it starts, and leaves: labkit needs none."""
    from yade import Omega

    with contextlib.suppress(OSError):
        os.rmdir(os.path.dirname(Omega().tmpFilename()))


sys.meta_path.insert(0, NoServers)
del sys.argv[0]
with open(sys.argv[0], encoding="utf-8") as program:  # here, because YADE needs the namespace of the main program
    exec(compile(program.read(), program.name, "exec"))
