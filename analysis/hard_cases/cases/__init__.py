"""The cases: one function per scene, with its name, that takes a Laboratory and returns a description and checks."""

from analysis.hard_cases.cases import cycles, grains, pressure, restart, steps, strains
from analysis.hard_cases.scenes import SCENES

MODULES = (pressure, cycles, steps, grains, strains, restart)
CASES = {name: next(getattr(module, name) for module in MODULES if hasattr(module, name)) for name in SCENES}
