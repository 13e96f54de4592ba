"""Probes of a state: small increments of strain or stress in many directions, each applied to the same state.

probing     describes the probes: plane, directions, amplitude, duration
rest        brings the grains to rest before they are probed
grains      probes the grains; model probes the constitutive model
probe_set   the results: stiffness, table and file
figure      the response envelope
command     the command `labkit probe`
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.probes.grains import at_rest as at_rest
    from labkit.plugins.probes.model import probe_model as probe_model
else:
    __getattr__, __dir__, __all__ = attach(__name__)
