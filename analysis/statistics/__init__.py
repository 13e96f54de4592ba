"""Statistics of independent specimens: means, differences, stationarity, "one line", and many comparisons at once.

The records of one test are correlated, and tests of one specimen share its packing. In every function the specimen
(the cluster) is the unit that counts: `estimates` has means and paired differences, `stationarity` the slope over the
last part of a test, `one_line` the test that all groups share a line, `multiplicity` corrections and verdicts.
"""

from analysis.statistics.estimates import (
    CONFIDENCE,
    NOTHING,
    Estimate,
    Tested,
    cluster_mean,
    paired_difference,
    student,
    t_interval,
    welch,
)
from analysis.statistics.multiplicity import (
    SIGNIFICANT,
    adjusted,
    adjusted_once,
    corrected,
    in_bold,
    judge_plan,
    resolved,
    verdict,
    with_verdict,
)
from analysis.statistics.one_line import OneLine, one_line
from analysis.statistics.stationarity import slope_of, slope_table, stationarity_table

__all__ = [
    "CONFIDENCE",
    "NOTHING",
    "SIGNIFICANT",
    "Estimate",
    "OneLine",
    "Tested",
    "adjusted",
    "adjusted_once",
    "cluster_mean",
    "corrected",
    "in_bold",
    "judge_plan",
    "one_line",
    "paired_difference",
    "resolved",
    "slope_of",
    "slope_table",
    "stationarity_table",
    "student",
    "t_interval",
    "verdict",
    "welch",
    "with_verdict",
]
