"""The stratified layer of Fig. 3: a plane layer of discs, coarse over fine.

layer      makes the layer, and computes the stresses in its strata
figure     draws the layer
"""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.plugins.stratified.figure import stratified_layer as stratified_layer
    from labkit.plugins.stratified.layer import Layer as Layer
    from labkit.plugins.stratified.layer import strata as strata
else:
    __getattr__, __dir__, __all__ = attach(__name__)
