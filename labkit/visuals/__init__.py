"""Figures, pictures, files for ParaView, and the view in the terminal."""

from labkit.lazy import attach

_NAMES = {
    "plots": "plots:",
    "micro_figures": "micro_figures:",
    "path_figures": "path_figures:",
    "sff_figures": "sff_figures:",
    "direction_figure": "direction_figure:",
    "layer_figure": "layer_figure:",
    "envelope_figure": "envelope_figure:",
    "draw_grains": "picture:picture",
    "Viewer": "viewer",
    "save": "plots",
    "WIDTH": "frame",
    "colors_for": "frame",
    "new_figure": "frame",
    "e_p_paths": "plots",
    "sff_against_love": "plots",
}

__getattr__, __dir__, __all__ = attach(__name__, _NAMES)
