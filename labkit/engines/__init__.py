"""Engines advance a State.

base          the interface of an engine, the engines by name, and the requests that a run makes of an engine
device        an engine together with its hardware
sorting       the order in which a State lists contacts
server        engines whose grains are in another process, and the messages to that process
yade          the YADE engine, the reference
mpi           MPI on this computer: its library, its launcher, and the memory that it needs
followers     MPI ranks: their start, their end, and how they repeat the calls of an engine
on_ranks      an engine on MPI ranks, as the run sees it
lammps        LAMMPS over MPI, the engine for specimens that one computer cannot hold
fused         labkit's own compiled engine; its loop is in kernel/
threads       number of threads of the fused engine
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.engines.base import ENGINES as ENGINES
    from labkit.engines.base import Engine as Engine
    from labkit.engines.base import Progress as Progress
    from labkit.engines.base import register_engine as register_engine
    from labkit.engines.device import Device as Device
    from labkit.engines.device import Fused as Fused
    from labkit.engines.device import Yade as Yade
    from labkit.engines.device import device_of as device_of
    from labkit.engines.fused import FusedEngine as FusedEngine
    from labkit.engines.yade import YadeEngine as YadeEngine
    from labkit.engines.yade import find_yade as find_yade
    from labkit.engines.yade import run_script as run_script
    from labkit.engines.yade import yade_program as yade_program
else:
    __getattr__, __dir__, __all__ = attach(__name__)
