"""Results of runs: Run, xarray datasets with the accessor `.lab`, figures by name, verification, critical states."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.records.limits import HELD_AFTER as HELD_AFTER
    from labkit.results.critical import ENOUGH_STRAIN as ENOUGH_STRAIN
    from labkit.results.critical import SHEAR as SHEAR
    from labkit.results.critical import TENSORS as TENSORS
    from labkit.results.critical import WINDOW as WINDOW
    from labkit.results.critical import critical_states as critical_states
    from labkit.results.critical import is_shear as is_shear
    from labkit.results.critical import require_critical as require_critical
    from labkit.results.dataset import open_run as open_run
    from labkit.results.dataset import open_state as open_state
    from labkit.results.dataset import snapshots as snapshots
    from labkit.results.figures import FIGURES as FIGURES
    from labkit.results.run import Run as Run
    from labkit.results.run import Snapshots as Snapshots
    from labkit.results.stationary import Slope as Slope
    from labkit.results.stationary import slope as slope
    from labkit.results.undrained import Liquefaction as Liquefaction
    from labkit.results.verify import SFF_PRESSURE as SFF_PRESSURE
    from labkit.results.verify import SFF_TOLERANCE as SFF_TOLERANCE
    from labkit.results.verify import Finding as Finding
    from labkit.results.verify import drift_share as drift_share
    from labkit.results.verify import findings as findings
else:
    __getattr__, __dir__, __all__ = attach(__name__)
