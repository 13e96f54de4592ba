"""The errors of the model in words and tables: by type of test over independent specimens, and of every test."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pandas

from analysis import markdown
from analysis.paper.ends import OTHERS
from analysis.paper.model_comparison import FAR_ENOUGH, LABELS, OURS, TABLE_2
from analysis.paper.specimens import specimens_of
from analysis.statistics import cluster_mean

KINDS = {"cv": "CV", "cr": "CR", "cp": "CP", "isoc": "ISOC", "isod": "ISOD", "cyclic_cp": "cyclic CP"}
FAILS = 1.5  # ratio of the errors of e and q above which the void ratio counts as poorly predicted


def summary(errors: pandas.DataFrame, table: Callable[..., str] = markdown.table) -> str:
    """Summary of the comparison in Markdown: median errors by type of test, failures of the model, errors per test.

    `errors`: from compare(), or read from model_errors.csv; `table`: formats a table from a header and rows of text.
    """
    independent = errors[~errors["run"].str.startswith(OTHERS)]
    kinds = independent.assign(kind=independent["path"].map(KINDS), specimen=specimens_of(independent["run"]))
    rows = []
    for kind in dict.fromkeys(KINDS.values()):
        for key, label in LABELS.items():
            own = kinds[(kinds["kind"] == kind) & (kinds["parameters"] == key)]
            if len(own):
                rows.append(
                    [
                        kind,
                        label,
                        str(len(own)),
                        str(own["specimen"].nunique()),
                        *(_mean(own, column) for column in SHOWN),
                        f"{own['reached'].min():.0%}",
                    ]
                )
    header = ("type of test", "parameters", "tests", "specimens", "q", "p", "e", "strain completed, at least")
    parts = [
        "Errors of the model (RMS over the strain), mean over specimens ± half-width of the 95 % interval: of q "
        "relative to the largest q, of p relative to the mean p, of e relative to its range in the test. Tests that "
        "repeat a specimen with another engine or contact law are left out here. *our parameters* were fitted to some "
        "of these tests; results/model_evidence judges calibrations on paths that were left out. "
        "`given`: the path prescribes the quantity. `ended`: the model "
        f"stopped before {FAR_ENOUGH:.0%} of the strain. *Another seed*: difference between two simulations of the "
        "same test, from specimens that differ only in their random seed.",
        table(header, rows),
        "\n".join(failures(errors)),
        "Errors of every test:",
        _per_test(errors, table),
    ]
    used = errors["run"][errors["calibrated_on"].astype(bool)]
    if len(used):
        fitted = f"Our parameters were fitted to {len(used)} tests: {', '.join(used)}."
        parts.insert(0, f"{fitted} The other tests are predictions.")
    return "\n\n".join(part for part in parts if part)


SHOWN = ("q_error", "p_error", "e_error_of_change")


def _mean(own: pandas.DataFrame, column: str) -> str:
    """Mean over specimens with its half-width, in per cent; `given` or `ended` if there is none."""
    found = cluster_mean(own[column], own["specimen"])
    if not np.isfinite(found.value):
        return _percent(found.value, own["reached"].max())
    return _percent(found.value) + (f" ± {found.within:.1%}" if np.isfinite(found.within) else "")


def failures(errors: pandas.DataFrame) -> list[str]:
    """Sentences on the shortcoming that the paper reports.

    The void ratio is predicted poorly in stress-controlled and cyclic tests. This is reproduced if the error of e,
    relative to its range, exceeds FAILS times the error of q, relative to the largest q. Further sentences name the
    tests that the model does not complete.
    """
    sentences = []
    errors = errors[~errors["run"].str.startswith(OTHERS)]
    for kind, paths in (("stress-controlled tests (CR, CP)", ("cr", "cp")), ("cyclic tests", ("cyclic_cp",))):
        for label in (TABLE_2, OURS):
            own = errors[errors["path"].isin(paths) & (errors["parameters"] == label)]
            e, q = own["e_error_of_change"].median(), own["q_error"].median()
            if not np.isfinite(e):
                continue
            reproduced = "reproduced" if e > FAILS * q else "not reproduced"
            sentences.append(
                f"- Void ratio in {kind}, {LABELS[label]}: the median error of e is {100 * e:.0f} % of its range; "
                f"that of q is {100 * q:.0f} % of its largest value. The shortcoming reported in the paper is "
                f"{reproduced}."
            )
    early = errors[errors["status"].fillna("").ne("") & (errors["reached"] < 1.0)]
    for _, row in early.iterrows():
        sentences.append(f"- {row['run']}, {LABELS[row['parameters']]}: the model stops early: {row['status']}.")
    return sentences


def _per_test(errors: pandas.DataFrame, table: Callable[..., str]) -> str:
    wide = errors.pivot(index="run", columns="parameters", values=[*SHOWN, "reached"])
    present = [label for label in (TABLE_2, OURS) if label in errors["parameters"].values]
    rows = [
        [
            name,
            *(
                _percent(wide.loc[name, (key, label)], wide.loc[name, ("reached", label)])
                for key in SHOWN
                for label in present
            ),
        ]
        for name in dict.fromkeys(errors["run"])
    ]
    names = {"q_error": "q", "p_error": "p", "e_error_of_change": "e"}
    header = ["test", *(f"{names[key]}, {LABELS[label]}" for key in SHOWN for label in present)]
    return table(header, rows) if rows else ""


def _percent(value: float, reached: float = 1.0) -> str:
    return f"{value:.1%}" if np.isfinite(value) else "given" if reached >= FAR_ENOUGH else "ended"
