"""Runs: the Python interface, results as value objects and xarray datasets, checks, and the critical state."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.records.limits import HELD_AFTER as HELD_AFTER
    from labkit.runs.judge.critical import ENOUGH_STRAIN as ENOUGH_STRAIN
    from labkit.runs.judge.critical import SHEAR as SHEAR
    from labkit.runs.judge.critical import TENSORS as TENSORS
    from labkit.runs.judge.critical import WINDOW as WINDOW
    from labkit.runs.judge.critical import critical_states as critical_states
    from labkit.runs.judge.critical import is_shear as is_shear
    from labkit.runs.judge.critical import require_critical as require_critical
    from labkit.runs.judge.stationary import Slope as Slope
    from labkit.runs.judge.stationary import slope as slope
    from labkit.runs.judge.verify import SFF_PRESSURE as SFF_PRESSURE
    from labkit.runs.judge.verify import SFF_TOLERANCE as SFF_TOLERANCE
    from labkit.runs.judge.verify import Finding as Finding
    from labkit.runs.judge.verify import drift_share as drift_share
    from labkit.runs.judge.verify import findings as findings
    from labkit.runs.read.dataset import open_run as open_run
    from labkit.runs.read.dataset import open_state as open_state
    from labkit.runs.read.dataset import snapshots as snapshots
    from labkit.runs.read.figures import FIGURES as FIGURES
    from labkit.runs.read.run import Run as Run
    from labkit.runs.read.run import Snapshots as Snapshots
    from labkit.runs.read.undrained import Liquefaction as Liquefaction
    from labkit.runs.run.laboratory import consolidate as consolidate
    from labkit.runs.run.laboratory import make_specimen as make_specimen
else:
    __getattr__, __dir__, __all__ = attach(__name__)
