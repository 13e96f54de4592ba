"""Stress-force-fabric equations: C0, the equation by volume, related equations, and what they neglect."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.sff.budget import PARTS as PARTS
    from labkit.sff.budget import error_budget as error_budget
    from labkit.sff.budget import standard_errors as standard_errors
    from labkit.sff.c0 import TERMS as TERMS
    from labkit.sff.c0 import bracket as bracket
    from labkit.sff.c0 import c0_stress as c0_stress
    from labkit.sff.c0 import sff_stress as sff_stress
    from labkit.sff.c0 import sff_stress_by_volume as sff_stress_by_volume
    from labkit.sff.c0 import strength_shares as strength_shares
    from labkit.sff.c0 import symmetric_product as symmetric_product
    from labkit.sff.family import FORMS as FORMS
    from labkit.sff.family import product_integral as product_integral
    from labkit.sff.family import sphere_integral as sphere_integral
    from labkit.sff.family import stress as stress
    from labkit.sff.family import tangential_coupling as tangential_coupling
    from labkit.sff.neglected import NEGLECTED as NEGLECTED
    from labkit.sff.neglected import neglected_terms as neglected_terms
else:
    __getattr__, __dir__, __all__ = attach(__name__)
