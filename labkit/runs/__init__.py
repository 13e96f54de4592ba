"""Results, as value objects and xarray datasets, checks, the critical state, and the Python interface."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.records.limits import HELD_AFTER as HELD_AFTER
    from labkit.runs.critical import ENOUGH_STRAIN as ENOUGH_STRAIN
    from labkit.runs.critical import SHEAR as SHEAR
    from labkit.runs.critical import TENSORS as TENSORS
    from labkit.runs.critical import WINDOW as WINDOW
    from labkit.runs.critical import critical_states as critical_states
    from labkit.runs.critical import is_shear as is_shear
    from labkit.runs.critical import require_critical as require_critical
    from labkit.runs.dataset import open_run as open_run
    from labkit.runs.dataset import open_state as open_state
    from labkit.runs.dataset import snapshots as snapshots
    from labkit.runs.figures import FIGURES as FIGURES
    from labkit.runs.laboratory import consolidate as consolidate
    from labkit.runs.laboratory import make_specimen as make_specimen
    from labkit.runs.probe_set import Probes as Probes
    from labkit.runs.probe_set import open_probes as open_probes
    from labkit.runs.probes import affine_stiffness as affine_stiffness
    from labkit.runs.probes import at_rest as at_rest
    from labkit.runs.run import Run as Run
    from labkit.runs.run import Snapshots as Snapshots
    from labkit.runs.undrained import Liquefaction as Liquefaction
    from labkit.runs.verify import SFF_PRESSURE as SFF_PRESSURE
    from labkit.runs.verify import SFF_TOLERANCE as SFF_TOLERANCE
    from labkit.runs.verify import Finding as Finding
    from labkit.runs.verify import drift_share as drift_share
    from labkit.runs.verify import findings as findings
else:
    __getattr__, __dir__, __all__ = attach(__name__)
