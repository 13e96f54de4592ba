"""Results: runs as value objects and as xarray datasets, checks, the critical state; and the Python interface."""

from labkit.lazy import attach

_NAMES = {
    "ENOUGH_STRAIN": "critical",
    "SHEAR": "critical",
    "TENSORS": "critical",
    "WINDOW": "critical",
    "critical_states": "critical",
    "is_shear": "critical",
    "require_critical": "critical",
    "HELD_AFTER": "verify",
    "SFF_PRESSURE": "verify",
    "SFF_TOLERANCE": "verify",
    "Finding": "verify",
    "drift_share": "verify",
    "findings": "verify",
    "affine_stiffness": "probes",
    "at_rest": "probes",
    "open_run": "dataset",
    "open_state": "dataset",
    "snapshots": "dataset",
    "FIGURES": "figures",
    "Probes": "probe_set",
    "open_probes": "probe_set",
    "Liquefaction": "undrained",
    "Run": "run",
    "Snapshots": "run",
    "consolidate": "laboratory",
    "make_specimen": "laboratory",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
