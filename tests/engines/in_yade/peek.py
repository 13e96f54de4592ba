"""labkit's server inside YADE, which also evaluates expressions, with which tests inspect YADE itself.

peek.py YADE_SCRIPTS SOCKET
"""

import socket
import sys

sys.path.append(sys.argv[1])

import numpy as np
import server


class Peek(server.Server):
    def evaluate(self, values, arrays):
        """The value of an expression, in which O, utils and np have the meaning that they have in YADE's scripts."""
        return {"value": eval(values["expression"], {"O": O, "utils": server.utils, "np": np})}, {}


Peek(socket.socket(fileno=int(sys.argv[2]))).serve()
