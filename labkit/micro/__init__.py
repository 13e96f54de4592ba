"""Micromechanics: numpy in, numpy out. Every statistic takes a Snapshot.

Each physical contact counts twice in the paper, once on each of its grains. `n n` and `n (x) f` are the
same on both sides, so that sums run over physical contacts with the weight of the two sides added.
"""

from labkit.lazy import attach

# At once: the submodule of the same name would hide a function that is imported when it is first used.
from labkit.micro.void_ratio import void_ratio as void_ratio

_ROOM = {
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
    "size_groups": ("GroupStresses", "diameter_edges", "group_stresses", "groups_by_diameter"),
    "snapshot": ("Law", "Material", "Snapshot", "contact_arms", "contacts_per_grain"),
    "stress": ("deviatoric_stress", "love_stress", "mean_stress", "relative_error"),
    "void_ratio": ("grain_volume", "lens_volume", "void_ratio", "void_ratio_nominal"),
}

__getattr__, __dir__, __all__ = attach(__name__, {name: file for file, names in _ROOM.items() for name in names})
