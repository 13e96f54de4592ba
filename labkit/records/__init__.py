"""What a run records: energy balance, limits, checkpoints and the run file."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.records.energy import BALANCE_LIMIT as BALANCE_LIMIT
    from labkit.records.energy import balance_error as balance_error
    from labkit.records.energy import drift_velocity as drift_velocity
    from labkit.records.energy import fluctuation_velocity as fluctuation_velocity
    from labkit.records.energy import kinetic_energy as kinetic_energy
    from labkit.records.limits import DRIFT_LIMIT as DRIFT_LIMIT
    from labkit.records.limits import GRAINS_LIMIT as GRAINS_LIMIT
    from labkit.records.limits import INERTIAL_LIMIT as INERTIAL_LIMIT
    from labkit.records.limits import OVERLAP_LIMIT as OVERLAP_LIMIT
    from labkit.records.limits import Exceeded as Exceeded
    from labkit.records.limits import exceeded_limits as exceeded_limits
    from labkit.records.limits import pressure_limit as pressure_limit
    from labkit.records.schedule import Options as Options
    from labkit.records.schedule import Schedule as Schedule
else:
    __getattr__, __dir__, __all__ = attach(__name__)
