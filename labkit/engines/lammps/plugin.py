"""The plug-in `lammps`: registers the engine and defines its Device."""

from __future__ import annotations

from labkit.engines.base import ENGINES
from labkit.engines.device import Device

ENGINES.offer("lammps", "labkit.engines.lammps.engine:LammpsEngine")


class Lammps(Device):
    """LAMMPS over MPI, for specimens that one computer cannot hold."""

    def __init__(self, ranks: int = 1) -> None:
        """Store the number of MPI ranks."""
        super().__init__("lammps", ranks=ranks)
