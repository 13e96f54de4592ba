"""Engines advance a State.

base          the interface of an engine, and the requests that a run makes of it
contacts      contacts as a State lists them
registry      the engines by name, and how they are started
server        engines whose grains live in another process, and the messages to that process
yade          the YADE engine, the reference
yade_process  finds YADE and runs scripts in it
lammps        LAMMPS over MPI, the engine for specimens that one computer cannot hold
fused         labkit's own compiled engine; its loop is in kernel/
cuda          States on a GPU; needs numba-cuda
threads       number of threads of the fused engine
speed         speed of an engine, measured in a separate process
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.engines.base import Engine as Engine
    from labkit.engines.base import Progress as Progress
    from labkit.engines.base import Start as Start
    from labkit.engines.fused import FusedEngine as FusedEngine
    from labkit.engines.registry import ENGINES as ENGINES
    from labkit.engines.registry import Fused as Fused
    from labkit.engines.registry import Yade as Yade
    from labkit.engines.registry import processors as processors
    from labkit.engines.registry import register_engine as register_engine
    from labkit.engines.registry import require_engine as require_engine
    from labkit.engines.registry import start_of as start_of
    from labkit.engines.registry import starter as starter
    from labkit.engines.yade import YadeEngine as YadeEngine
    from labkit.engines.yade_process import find_yade as find_yade
    from labkit.engines.yade_process import yade_program as yade_program
else:
    __getattr__, __dir__, __all__ = attach(__name__)
