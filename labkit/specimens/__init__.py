"""Specimens: insertion, compression, consolidation and rest."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.specimens.recipe import SETTINGS as SETTINGS
    from labkit.specimens.recipe import Recipe as Recipe
    from labkit.specimens.recipe import mean_grain_volume as mean_grain_volume
    from labkit.specimens.recipe import side_for as side_for
    from labkit.specimens.specimen import insert_grains as insert_grains
    from labkit.specimens.specimen import skempton_b as skempton_b
else:
    __getattr__, __dir__, __all__ = attach(__name__)
