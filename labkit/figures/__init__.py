"""Figures of runs and states; the pictures are from the plug-in labkit.plugins.pictures."""

from typing import TYPE_CHECKING

from labkit.lazy import attach

if TYPE_CHECKING:
    from labkit.figures import direction_figure as direction_figure
    from labkit.figures import micro_figures as micro_figures
    from labkit.figures import path_figures as path_figures
    from labkit.figures import plots as plots
    from labkit.figures import sff_figures as sff_figures
    from labkit.figures.frame import WIDTH as WIDTH
    from labkit.figures.frame import colors_for as colors_for
    from labkit.figures.frame import new_figure as new_figure
    from labkit.figures.plots import e_p_paths as e_p_paths
    from labkit.figures.plots import save as save
    from labkit.figures.plots import sff_against_love as sff_against_love
    from labkit.plugins.pictures.picture import draw_grains as draw_grains
    from labkit.plugins.pictures.viewer import Viewer as Viewer
else:
    __getattr__, __dir__, __all__ = attach(__name__)
