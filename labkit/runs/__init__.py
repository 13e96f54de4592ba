"""What came out: runs as values and as xarray, checks, the critical state; and the front door in Python."""

from labkit.lazy import attach

_NAMES = {
    "SHEAR": "critical",
    "TENSORS": "critical",
    "WINDOW": "critical",
    "critical_states": "critical",
    "is_shear": "critical",
    "HELD_AFTER": "verify",
    "SFF_PRESSURE": "verify",
    "SFF_TOLERANCE": "verify",
    "Finding": "verify",
    "drift_share": "verify",
    "findings": "verify",
    "open_run": "dataset",
    "open_state": "dataset",
    "snapshots": "dataset",
    "FIGURES": "figures",
    "Run": "run",
    "Snapshots": "run",
    "consolidate": "laboratory",
    "make_specimen": "laboratory",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
