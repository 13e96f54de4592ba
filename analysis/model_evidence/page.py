"""The page of the study: tables, and the sentences that follow from them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np
import pandas

from analysis.markdown import table
from analysis.model_evidence.calibrations import AMENDED, CALIBRATED, FROM_Z_AND_A, PATHS, TABLE_2
from analysis.model_evidence.errors import QUANTITIES
from analysis.model_evidence.figures import NAMES
from analysis.model_evidence.new_tests import STRAIN

SHOWN = (TABLE_2, CALIBRATED, AMENDED, FROM_Z_AND_A)
SHORT = {"q_error": "q", "p_error": "p", "e_error_of_change": "e"}


def page(tables: Mapping[str, pandas.DataFrame], command: str) -> str:
    """README.md of the study."""
    parts = [
        "# What the constitutive model is worth",
        "Every test is predicted by a calibration on the tests along all *other* paths (leave one path out), and a "
        "specimen counts once. The tests are those of results/paper: 30 tests on 12 specimens; those on other engines "
        "and contact laws are left out. Nothing was simulated for this page.",
        f"Written by `{command}` from the reduced run files and calibrations.json; `--refit` repeats the fits.",
        "## Errors on paths that the model was not calibrated on",
        "![errors](errors.png)",
        "RMS errors over the strain, in %, of q relative to the largest q, of p relative to the mean p and of e "
        "relative to its range; mean over specimens ± half-width of the 95 % interval.",
        _errors(tables["summary"]),
        "All paths and quantities at once: ratio of the errors on the same tests, geometric mean over specimens, "
        "corrected for the number of rows (Holm). *failed*: tests that only this model does not complete.",
        _combined(tables["combined"]),
        "The amendment was chosen with these tests (below): new ones judge it.",
        *_new(tables),
        "## Is F the missing element of C1 (section 5.3)?",
        "Each equation is fitted to the recorded increments along all other paths, from the recorded state; what is "
        "left on the path left out is regressed on a further quantity, whose coefficient is also fitted on the other "
        "paths. *gain*: share of the remaining sum of squares that the quantity removes.",
        _missing(tables["missing_elements"]),
        _answer(tables["missing_elements"]),
        "## Forms of C4",
        "*By distance*: f |Λ^c - Λ|^gamma (Λ^c - Λ) |rate|. *Reported void ratio*: Λ^c at the void ratio without the "
        "overlap lenses. *Amended*: the additional term c Λ (q/p - M) |rate|, zero at the critical stress ratio, "
        "which lowers Λ after a reversal and in the contraction before the critical stress ratio and raises it in "
        "dilation.",
        _forms(tables["forms_of_c4"]),
        "## Is the suggested calibration from Z and A alone possible (section 5.4)?",
        "From the stress, e, Z and A, C0 gives Λ and one anisotropy of the forces; F and F^t cannot be separated.",
        _inversion(tables["inversion"]),
        "Parameters fitted to such data (F^t counted as part of F) are judged in the tables above, as "
        f"*{FROM_Z_AND_A}*.",
    ]
    return "\n\n".join(parts) + "\n"


def _percent(value: float, within: float = np.nan) -> str:
    if not np.isfinite(value):
        return ""
    return f"{100 * value:.1f}" + (f" ± {100 * within:.1f}" if np.isfinite(within) else "")


def _errors(summary: pandas.DataFrame) -> str:
    rows = []
    for path in dict.fromkeys(summary["path"]):
        for quantity in QUANTITIES:
            own = summary[(summary["path"] == path) & (summary["quantity"] == quantity)].set_index("model")
            if len(own):
                cells = [_percent(own["value"].get(m, np.nan), own["within"].get(m, np.nan)) for m in SHOWN]
                rows.append([NAMES.get(path, path), SHORT[quantity], str(own["specimens"].max()), *cells])
    return table(["path", "error of", "specimens", *SHOWN], rows, range(2, 3 + len(SHOWN)))


def _combined(frame: pandas.DataFrame) -> str:
    rows = [
        [
            row.model,
            row.against,
            str(row.tests),
            str(row.specimens),
            f"{row.ratio:.2f} ({row.low:.2f} to {row.high:.2f})",
            f"{row.p_value:.2g}",
            f"{row.corrected:.2g}",
            str(row.failed),
            row.verdict,
        ]
        for row in frame.itertuples()
    ]
    header = ["model", "against", "tests", "specimens", "ratio of errors", "p-value", "Holm", "failed", "verdict"]
    return table(header, rows, range(2, 8))


def _new(tables: Mapping[str, pandas.DataFrame]) -> list[str]:
    """The section on tests that no model was fitted to; empty without them."""
    if "new_combined" not in tables:
        return []
    errors = tables["new_errors"].drop_duplicates("run")
    parts = [
        "## On new tests",
        f"The tests of [results/critical_state](../critical_state/README.md) with the paper's rule of stiffness, up to "
        f"{100 * STRAIN:.0f} % of strain: {len(errors)} tests on {errors['specimen'].nunique()} specimens, which "
        "served neither to fit the models nor to choose among them. The calibrated models are fitted to all monotonic "
        "and isotropic tests of one seed of the paper's campaign. Tables as above; corrected for the rows of each.",
        _errors(tables["new_summary"]),
    ]
    for name, rows in tables["new_combined"].groupby("direction", sort=False):
        parts += [f"In {name}:", _combined(rows)]
    return parts


def _gains(frame: pandas.DataFrame, first: Iterable[str]) -> str:
    names = list(first)
    rows = [
        [
            *(str(getattr(row, name)) for name in names),
            str(row.specimens),
            ""
            if not np.isfinite(row.p_value)
            else f"{_percent(row.gain)} ({_percent(row.low)} to {_percent(row.high)})",
            "" if not np.isfinite(row.p_value) else f"{row.corrected:.2g}",
            "" if not np.isfinite(row.p_value) else row.verdict,
        ]
        for row in frame.itertuples()
    ]
    return table([*names, "specimens", "gain, %", "Holm", "verdict"], rows, range(len(names), len(names) + 3))


def _missing(frame: pandas.DataFrame) -> str:
    shown = frame.assign(explained=[f"{100 * value:.0f} %" for value in frame["explained"]])
    return _gains(shown, ("equation", "explained", "candidate"))


def _answer(frame: pandas.DataFrame) -> str:
    own = frame[(frame["equation"] == "C1") & frame["candidate"].str.startswith("F")]
    better = own[own["verdict"] == "better"]
    if len(better):
        return f"In C1, {', '.join(better['candidate'])} removes a resolved share of what is left."
    most = own.loc[own["high"].idxmax()]
    return (
        f"No form of F in C1 removes a resolved share of what C1 leaves; the largest gain that the intervals allow is "
        f"{_percent(most['high'])} % ({most['candidate']}). F is not shown to be the missing element of C1."
    )


def _forms(frame: pandas.DataFrame) -> str:
    shown = frame.copy()
    for path in PATHS:
        shown[NAMES[path]] = [f"{100 * value:.0f} %" for value in frame[f"explained_{path}"]]
    return _gains(shown, ("form", *(NAMES[path] for path in PATHS)))


def _inversion(frame: pandas.DataFrame) -> str:
    rows = [
        [
            row.quantity,
            str(row.tests),
            str(row.specimens),
            f"{row.mean:+.3f} ± {row.within:.3f}",
            f"{row.rms:.3f}",
        ]
        for row in frame.itertuples()
    ]
    header = ["quantity", "tests", "specimens", "inverted minus measured (Λ: relative)", "RMS"]
    return table(header, rows, range(1, 5))
