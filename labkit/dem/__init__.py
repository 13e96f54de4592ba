"""Discrete elements: scene, contact laws, state, specimens, paths, servo and the simulation that joins them."""

from labkit.lazy import attach

_NAMES = {
    "BALANCE_LIMIT": "energy", "kinetic_energy": "energy", "fluctuation_velocity": "energy",
    "drift_velocity": "energy", "balance_error": "energy", "DRIFT_LIMIT": "limits", "GRAINS_LIMIT": "limits",
    "INERTIAL_LIMIT": "limits", "OVERLAP_LIMIT": "limits", "Exceeded": "limits", "exceeded": "limits",
    "pressure_limit": "limits", "PRESSURE_LIMIT": "paths", "PATHS": "paths", "REVERSALS": "paths", "Biaxial": "paths",
    "ConstantMeanStress": "paths", "ConstantRadialStress": "paths", "ConstantVolume": "paths",
    "Consolidation": "paths", "Control": "paths", "CyclicConstantMeanStress": "paths", "Held": "paths",
    "IsotropicCompression": "paths", "IsotropicDilation": "paths", "Path": "paths", "StressPath": "paths",
    "make_path": "paths", "travelled": "paths", "LAWS": "laws", "ContactLaw": "laws", "read_checkpoint": "recorder",
    "Scene": "scene", "STANDARD": "servo", "Servo": "servo", "cell_stiffness": "servo", "velocity_gradient": "servo",
    "SETTINGS": "settings", "Options": "simulation", "Schedule": "simulation", "Recipe": "specimen",
    "insert_grains": "specimen", "mean_grain_volume": "specimen", "side_for": "specimen", "Ledger": "state",
    "State": "state", "grains_in_cell": "state", "read_state": "state", "write_state": "state",
    "critical_time_step": "time_step", "Layer": "stratified", "strata": "stratified", "Start": "engine",
    "Engine": "engine", "Progress": "engine",
}  # fmt: skip

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
