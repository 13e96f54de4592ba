"""Loading paths: their interface, mixed control, and the registered paths.

Every registered path, also one that a user registers, has a class here, such as `labkit.paths.SimpleShear`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from labkit.errors import nearest
from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.paths.control import Control as Control
    from labkit.paths.cycles import DrainedCycles as DrainedCycles
    from labkit.paths.cycles import ShearCycles as ShearCycles
    from labkit.paths.cycles import StrainCycles as StrainCycles
    from labkit.paths.cycles import UndrainedCycles as UndrainedCycles
    from labkit.paths.element_tests import ConstantAxialStress as ConstantAxialStress
    from labkit.paths.element_tests import Mixed as Mixed
    from labkit.paths.element_tests import Oedometer as Oedometer
    from labkit.paths.element_tests import PlaneStrain as PlaneStrain
    from labkit.paths.element_tests import ProportionalStrain as ProportionalStrain
    from labkit.paths.element_tests import SimpleShear as SimpleShear
    from labkit.paths.element_tests import SimpleShearConstantVolume as SimpleShearConstantVolume
    from labkit.paths.element_tests import StressRotation as StressRotation
    from labkit.paths.element_tests import TrueTriaxial as TrueTriaxial
    from labkit.paths.mixed_step import MixedStep as MixedStep
    from labkit.paths.path import Held as Held
    from labkit.paths.path import Path as Path
    from labkit.paths.path import StressPath as StressPath
    from labkit.paths.probes import StrainProbe as StrainProbe
    from labkit.paths.probes import StressProbe as StressProbe
    from labkit.paths.registry import PATHS as PATHS
    from labkit.paths.registry import accumulated_strain as accumulated_strain
    from labkit.paths.registry import make_path as make_path
    from labkit.paths.registry import path_of as path_of
    from labkit.paths.registry import register_path as register_path
    from labkit.paths.standard import PRESSURE_LIMIT as PRESSURE_LIMIT
    from labkit.paths.standard import REVERSALS as REVERSALS
    from labkit.paths.standard import Biaxial as Biaxial
    from labkit.paths.standard import Consolidation as Consolidation
    from labkit.paths.standard import ConstantMeanStress as ConstantMeanStress
    from labkit.paths.standard import ConstantRadialStress as ConstantRadialStress
    from labkit.paths.standard import ConstantVolume as ConstantVolume
    from labkit.paths.standard import CyclicConstantMeanStress as CyclicConstantMeanStress
    from labkit.paths.standard import IsotropicCompression as IsotropicCompression
    from labkit.paths.standard import IsotropicDilation as IsotropicDilation
    from labkit.paths.step import Here as Here
    from labkit.paths.step import RecordMeets as RecordMeets
    from labkit.paths.step import Step as Step
    from labkit.paths.step import StrainLimit as StrainLimit
    from labkit.paths.step import StrainReached as StrainReached
    from labkit.paths.step import StressReached as StressReached
    from labkit.paths.steps import Steps as Steps
    from labkit.paths.strain_measures import NORM as NORM
    from labkit.paths.strain_measures import StrainMeasure as StrainMeasure
    from labkit.paths.stress_reversals import IsotropicReloading as IsotropicReloading
    from labkit.paths.stress_reversals import OedometerReloading as OedometerReloading
    from labkit.paths.variables import increments as increments
else:
    _get, _names, __all__ = attach(__name__)

    def _classes() -> dict[str, type[Path]]:
        """Return the classes of the registered paths by name."""
        from labkit.paths.registry import PATHS

        return {kind.__name__: kind for kind in PATHS.values()}

    def __getattr__(name: str) -> object:
        if name in __all__:
            return _get(name)
        classes = {} if name.startswith("_") else _classes()
        if name in classes:
            return classes[name]
        close = nearest(name, classes)
        hint = f". Did you mean: {close!r}?" if close else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")

    def __dir__() -> list[str]:
        return sorted({*_names(), *_classes()})
