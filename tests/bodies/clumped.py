"""States of clumps."""

from labkit.bodies.shapes import clumps_in_place_of


def clumped(state, shapes, seed=0):
    """Clumps in place of the grains of a State at rest, without contacts."""
    return state.replace(**clumps_in_place_of(state.radius, state.position, shapes, seed))
