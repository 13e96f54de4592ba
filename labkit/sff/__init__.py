"""Stress-force-fabric relationships: C0, its family, and what the error of C0 is made of."""

from labkit.lazy import attach

_ROOM = {
    "budget": ("PARTS", "error_budget", "standard_errors"),
    "c0": ("TERMS", "bracket", "c0_stress", "sff_stress", "strength_shares", "symmetric_product"),
    "family": ("FORMS", "product_integral", "sphere_integral", "stress", "tangential_coupling"),
}

__getattr__, __dir__, __all__ = attach(__name__, {name: file for file, names in _ROOM.items() for name in names})
