"""The cases: one function per scene, of the same name, that takes a Laboratory and returns description and checks."""

from analysis.hard_cases.cases.cycles import growing_cycles, many_cycles
from analysis.hard_cases.cases.grains import deep_overlaps, few_grains, size_ratio_5
from analysis.hard_cases.cases.pressure import (
    gentle_servo,
    isoc_beyond,
    isod_to_nothing,
    loose_cv,
    very_dense,
    very_loose,
)
from analysis.hard_cases.cases.restart import restart_in_reversal
from analysis.hard_cases.cases.steps import fast, step_outgrown, step_over, step_under
from analysis.hard_cases.cases.strains import strain_100, thin_cell

CASES = {
    case.__name__: case
    for case in (
        loose_cv,
        isod_to_nothing,
        isoc_beyond,
        growing_cycles,
        many_cycles,
        very_dense,
        very_loose,
        step_under,
        step_over,
        step_outgrown,
        fast,
        deep_overlaps,
        size_ratio_5,
        few_grains,
        strain_100,
        thin_cell,
        restart_in_reversal,
        gentle_servo,
    )
}
