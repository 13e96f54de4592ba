"""Stress-force-fabric equations: C0, related equations, and the contributions to the error of C0."""

from labkit.lazy import attach

_NAMES = {
    "budget": ("PARTS", "error_budget", "standard_errors"),
    "c0": ("TERMS", "bracket", "c0_stress", "sff_stress", "strength_shares", "symmetric_product"),
    "family": ("FORMS", "product_integral", "sphere_integral", "stress", "tangential_coupling"),
}

__getattr__, __dir__, __all__ = attach(__name__, {name: file for file, names in _NAMES.items() for name in names})
