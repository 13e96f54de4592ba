"""Micromechanical statistics as numpy arrays; every statistic is a function of a Snapshot.

The paper counts each physical contact twice, once for each of its grains. Because `n n` and `n (x) f` are equal on both
sides, the sums here run over physical contacts, and the weight of a contact is the sum of the weights of its sides.
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

# Imported immediately: a lazily imported function would be hidden by the submodule of the same name.
from labkit.micro.void_ratio import void_ratio as void_ratio

if TYPE_CHECKING:
    from labkit.micro.bodies import axis_anisotropy as axis_anisotropy
    from labkit.micro.bodies import branch_anisotropy as branch_anisotropy
    from labkit.micro.bodies import contacts_per_pair as contacts_per_pair
    from labkit.micro.bodies import stress_along_normals as stress_along_normals
    from labkit.micro.contact_sides import Vectors as Vectors
    from labkit.micro.contact_sides import mean_volume as mean_volume
    from labkit.micro.contact_sides import normalisation as normalisation
    from labkit.micro.contact_sides import normalised_force as normalised_force
    from labkit.micro.contact_sides import normalised_normal_force as normalised_normal_force
    from labkit.micro.contact_sides import vectors_of_contacts as vectors_of_contacts
    from labkit.micro.contact_sides import vectors_of_sides as vectors_of_sides
    from labkit.micro.directions import bin_means as bin_means
    from labkit.micro.directions import hemisphere_bins as hemisphere_bins
    from labkit.micro.directions import polar_bins as polar_bins
    from labkit.micro.eccentricity import contact_eccentricity as contact_eccentricity
    from labkit.micro.eccentricity import eccentric_dyads as eccentric_dyads
    from labkit.micro.eccentricity import normal_force_eccentricity as normal_force_eccentricity
    from labkit.micro.eccentricity import tangential_arms as tangential_arms
    from labkit.micro.fabric import DirectionalFit as DirectionalFit
    from labkit.micro.fabric import Series as Series
    from labkit.micro.fabric import Statistics as Statistics
    from labkit.micro.fabric import TangentialFit as TangentialFit
    from labkit.micro.fabric import contact_anisotropy as contact_anisotropy
    from labkit.micro.fabric import directional_fit as directional_fit
    from labkit.micro.fabric import directional_mean as directional_mean
    from labkit.micro.fabric import normal_density as normal_density
    from labkit.micro.fabric import second_order as second_order
    from labkit.micro.fabric import series_of as series_of
    from labkit.micro.fabric import statistics as statistics
    from labkit.micro.fabric import statistics_by_volume as statistics_by_volume
    from labkit.micro.fabric import tangential_mean as tangential_mean
    from labkit.micro.fabric import traceless as traceless
    from labkit.micro.grains import grain_fabric as grain_fabric
    from labkit.micro.grains import grain_stress as grain_stress
    from labkit.micro.grains import mean_per_grain as mean_per_grain
    from labkit.micro.grains import sum_per_grain as sum_per_grain
    from labkit.micro.indicators import elastic_energy as elastic_energy
    from labkit.micro.indicators import inertial_number as inertial_number
    from labkit.micro.indicators import overlap_ratio as overlap_ratio
    from labkit.micro.indicators import rattler_fraction as rattler_fraction
    from labkit.micro.indicators import redundancy_index as redundancy_index
    from labkit.micro.indicators import resultant_forces as resultant_forces
    from labkit.micro.indicators import unbalanced_force as unbalanced_force
    from labkit.micro.networks import Lives as Lives
    from labkit.micro.networks import follow as follow
    from labkit.micro.networks import network_stress as network_stress
    from labkit.micro.networks import strong_by_force as strong_by_force
    from labkit.micro.networks import strong_by_normalised_force as strong_by_normalised_force
    from labkit.micro.planes import plane_normal as plane_normal
    from labkit.micro.planes import plane_tractions as plane_tractions
    from labkit.micro.size_groups import GroupStresses as GroupStresses
    from labkit.micro.size_groups import diameter_edges as diameter_edges
    from labkit.micro.size_groups import group_stresses as group_stresses
    from labkit.micro.size_groups import groups_by_diameter as groups_by_diameter
    from labkit.micro.snapshot import NO_CONTACTS as NO_CONTACTS
    from labkit.micro.snapshot import ContactMaterial as ContactMaterial
    from labkit.micro.snapshot import Contacts as Contacts
    from labkit.micro.snapshot import Law as Law
    from labkit.micro.snapshot import Snapshot as Snapshot
    from labkit.micro.snapshot import branch_vectors as branch_vectors
    from labkit.micro.snapshot import contact_arms as contact_arms
    from labkit.micro.snapshot import contacts_per_grain as contacts_per_grain
    from labkit.micro.snapshot import love_stress as love_stress
    from labkit.micro.stress import along_deviator as along_deviator
    from labkit.micro.stress import deviator as deviator
    from labkit.micro.stress import deviatoric_stress as deviatoric_stress
    from labkit.micro.stress import equivalent_stress as equivalent_stress
    from labkit.micro.stress import lode_angle as lode_angle
    from labkit.micro.stress import mean_stress as mean_stress
    from labkit.micro.stress import relative_error as relative_error
    from labkit.micro.tensors import symmetric as symmetric
    from labkit.micro.tensors import to_six as to_six
    from labkit.micro.void_ratio import grain_volume as grain_volume
    from labkit.micro.void_ratio import lens_volume as lens_volume
    from labkit.micro.void_ratio import void_ratio as void_ratio
    from labkit.micro.void_ratio import void_ratio_nominal as void_ratio_nominal
else:
    __getattr__, __dir__, __all__ = attach(__name__)
