"""Micromechanical statistics as numpy arrays. Every statistic is a function of a Snapshot.

The paper counts each physical contact twice, once for each of its grains. Because `n n` and `n (x) f` are equal on both
sides, the sums here run over physical contacts, each weighted with the sum of the weights of its two sides.
"""

from labkit.lazy import attach

# Imported immediately: a lazily imported function would be hidden by the submodule of the same name.
from labkit.micro.void_ratio import void_ratio as void_ratio

_NAMES = {
    "contacts": ("Contacts", "NO_CONTACTS", "branch_vectors"),
    "directions": (
        "Fit",
        "TangentialFit",
        "bin_means",
        "directional_mean",
        "fit",
        "hemisphere_bins",
        "normal_density",
        "polar_bins",
        "second_order",
        "tangential_mean",
        "traceless",
    ),
    "fabric": ("Series", "Statistics", "contact_anisotropy", "series_of", "statistics"),
    "grains": ("grain_fabric", "grain_stress", "mean_per_grain", "sum_per_grain"),
    "indicators": (
        "elastic_energy",
        "inertial_number",
        "overlap_ratio",
        "rattler_fraction",
        "resultant_forces",
        "unbalanced_force",
    ),
    "networks": ("Lives", "follow", "network_stress"),
    "normalised": (
        "Vectors",
        "normalisation",
        "normalised_force",
        "normalised_normal_force",
        "strong_by_force",
        "strong_by_normalised_force",
        "vectors_of_contacts",
        "vectors_of_sides",
    ),
    "planes": ("plane_normal", "plane_tractions"),
    "size_groups": ("GroupStresses", "diameter_edges", "group_stresses", "groups_by_diameter"),
    "snapshot": ("Law", "Material", "Snapshot", "contact_arms", "contacts_per_grain"),
    "stress": (
        "along_deviator",
        "deviatoric_stress",
        "deviator",
        "equivalent_stress",
        "lode_angle",
        "love_stress",
        "mean_stress",
        "relative_error",
    ),
    "void_ratio": ("grain_volume", "lens_volume", "void_ratio", "void_ratio_nominal"),
}

__getattr__, __dir__, __all__ = attach(__name__, {name: file for file, names in _NAMES.items() for name in names})
