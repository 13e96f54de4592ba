"""What the plug-in lammps adds to labkit."""

from __future__ import annotations

from labkit.engines.registry import ENGINES, Start, starter

ENGINES.offer("lammps", "labkit.engines.lammps.engine:LammpsEngine")


class Lammps(Start):
    """LAMMPS over MPI, for specimens that one computer cannot hold."""

    def __init__(self, ranks: int = 1) -> None:
        """ranks: number of MPI ranks."""
        super().__init__(**vars(starter("lammps", ranks)))
