"""The grains to be modelled: scene, gradings, contact laws, state, cell and time step."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.grains import laws as laws
    from labkit.grains.laws import LAWS as LAWS
    from labkit.grains.laws import ContactLaw as ContactLaw
    from labkit.grains.scene import Scene as Scene
    from labkit.grains.state import Ledger as Ledger
    from labkit.grains.state import State as State
    from labkit.grains.state import grains_in_cell as grains_in_cell
    from labkit.grains.state_file import read_state as read_state
    from labkit.grains.state_file import write_state as write_state
    from labkit.grains.time_step import critical_time_step as critical_time_step
else:
    __getattr__, __dir__, __all__ = attach(__name__)
