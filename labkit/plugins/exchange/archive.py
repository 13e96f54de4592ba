"""State files that need no netCDF library, for the laboratory in a web page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from labkit.grains.state_file import write_state
from labkit.plugins.exchange.formats import Format

if TYPE_CHECKING:
    from labkit.grains.state import State


class StateArchive(Format):
    """State file of labkit as an archive of NumPy arrays, which the page of `labkit page` loads."""

    name = "state_archive"
    endings = (".state.npz",)
    keeps_clumps = keeps_contacts = True

    def write(self, state: State, file: Path) -> None:
        write_state(file, state)
