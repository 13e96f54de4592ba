"""The page of the study: what was tested, the tables, and the sentences that follow from them."""

from __future__ import annotations

from collections.abc import Mapping

import pandas

from analysis.markdown import table
from analysis.other_paths.engines import QUANTITIES
from analysis.other_paths.errors import COMPONENTS, REFERENCE
from analysis.other_paths.figures import TESTS
from analysis.statistics import SIGNIFICANT
from labkit.sff import PARTS

FORMS = {
    "c0": "C0",
    "c0_tangential": "with the tangential force to second order",
    "c0_volume": "without equal stress in all sizes",
    "c0_fourth": "with fourth-order tensors",
    "fourth": "all three",
}


def page(tables: Mapping[str, pandas.DataFrame], ratio: Mapping[str, float], command: str) -> str:
    """README.md of the study."""
    return (
        "\n\n".join(
            [
                "# Loading paths beyond the paper's",
                "The paper tests C0 in axisymmetric compression alone. Here C0 is compared with Love's stress on true "
                "triaxial paths, in extension, in simple shear and under rotating principal stresses; strengths are "
                "compared: specimens of 4,000 grains at medium density, 500 kPa, `fused` with the spring-dashpot "
                "law (`analysis/other_paths/paths.yaml`). A specimen counts once in every interval and test.",
                f"Written by `{command}`; the runs by `./lab other-paths PATHS ENGINES`, each campaign in its folder.",
                "## Error of C0",
                "![errors](c0_errors.png)",
                "Errors relative to Love's stress, means over the test with p > 50 kPa (q: where q > 0.2 p) and over "
                "the specimens; components (%): root mean square over p; angle: of the major principal stress in the "
                "x-z plane.",
                _errors(tables["c0_errors"]),
                "Against compression on the same specimens, absolute errors, paired t-tests, corrected for all "
                f"{int(tables['c0_comparison']['p_value'].notna().sum())} of them (Benjamini and Hochberg):",
                _comparison(tables["c0_comparison"]),
                _verdict(tables["c0_comparison"]),
                "### Which assumption",
                "Contribution of each assumption of C0 to its error in q, in % of q (snapshots with q > 0.2 p):",
                _budget(tables["c0_budget"]),
                "Error in q (%) of the related equations at the snapshots:",
                _forms(tables["c0_forms"]),
                "![components](c0_components.png)",
                "## Strength",
                "![strength](strength.png)",
                "M = q/p with q = sqrt(3/2)|s|, mean over the last quarter of the strain. `slope`: change of M per 0.1 "
                "of strain within that quarter, with the p-value of a t-test over the specimens that it is zero.",
                _strength(tables["strength"]),
                _ratio(tables, ratio),
                *(_engines(tables["engines"]) if "engines" in tables else ()),
                *(_liquefaction(tables["liquefaction"]) if "liquefaction" in tables else ()),
            ]
        )
        + "\n"
    )


def _order(names: pandas.Series) -> list[str]:
    return [test for test in TESTS if (names == test).any()]


def _percent(value: float, digits: int = 2) -> str:
    return "" if pandas.isna(value) else f"{100 * value:+.{digits}f}"


def _errors(errors: pandas.DataFrame) -> str:
    header = ["test", "specimens", "p (%)", "q (%)", "q/p (%)", "norm (%)", "worst (%)", *COMPONENTS, "angle (deg)"]
    rows = []
    for test in _order(errors["test"]):
        group = errors[errors["test"] == test]
        mean = group.mean(numeric_only=True)
        rows.append(
            [
                TESTS[test],
                str(len(group)),
                *(_percent(mean[name]) for name in ("p", "q", "ratio")),
                f"{100 * mean['norm']:.2f}",
                f"{100 * group['worst'].max():.2f}",
                *(f"{100 * mean[name]:.2f}" for name in COMPONENTS),
                "" if pandas.isna(mean["angle"]) else f"{mean['angle']:.2f}",
            ]
        )
    return table(header, rows, range(1, len(header)))


def _comparison(frame: pandas.DataFrame) -> str:
    header = ["test", "quantity", "specimens", "difference (%)", "95 % (%)", "limit (%)"]
    header += ["p-value", "corrected", "verdict"]
    rows = [
        [
            TESTS[row.test],
            row.quantity,
            str(row.specimens),
            _percent(row.difference),
            "" if pandas.isna(row.within) else f"{100 * row.within:.2f}",
            "" if pandas.isna(row.limit) else f"{100 * row.limit:.1f}",
            "" if pandas.isna(row.p_value) else f"{row.p_value:.2g}",
            "" if pandas.isna(row.corrected) else f"{row.corrected:.2g}",
            row.verdict,
        ]
        for row in frame.itertuples()
    ]
    return table(header, rows, range(2, 8))


def _verdict(frame: pandas.DataFrame) -> str:
    """The sentence about the comparison with compression."""

    def named(verdict: str) -> str:
        rows = frame[frame["verdict"] == verdict]
        return "; ".join(f"{TESTS[row.test]}, {row.quantity}" for row in rows.itertuples()) or "no path"

    limits = frame.groupby("quantity")["limit"].agg(["min", "max"])
    excluded = ", ".join(
        f"{100 * low:.1f} to {100 * high:.1f} points in {name}" for name, low, high in limits.itertuples()
    )
    return (
        f"Less accurate than in compression: {named('less accurate')}. More accurate: {named('more accurate')}.\n\n"
        "That no other difference is resolved does not show that C0 is as accurate on all paths: with these specimens "
        f"the limits of equivalence, depending on the path, are {excluded}."
    )


def _budget(budget: pandas.DataFrame) -> str:
    wide = budget.pivot_table(index="test", columns="part", values="q")
    shown = [part for part in PARTS if wide[part].abs().max() > 1e-4]
    rows = [[TESTS[test], *(_percent(wide.loc[test, part]) for part in shown)] for test in _order(budget["test"])]
    return table(["test", *(PARTS[part] for part in shown)], rows, range(1, len(shown) + 1))


def _forms(forms: pandas.DataFrame) -> str:
    wide = forms.pivot_table(index="test", columns="form", values="q")
    rows = [[TESTS[test], *(_percent(wide.loc[test, form]) for form in FORMS)] for test in _order(forms["test"])]
    return table(["test", *FORMS.values()], rows, range(1, len(FORMS) + 1))


def _strength(means: pandas.DataFrame) -> str:
    by_test = means.set_index("test")
    rows = []
    for test in _order(means["test"]):
        row = by_test.loc[test]
        rows.append(
            [
                TESTS[test],
                str(int(row["specimens"])),
                f"{row['b']:.2f}",
                f"{row['M']:.3f}" + ("" if pandas.isna(row["within"]) else f" ± {row['within']:.3f}"),
                f"{row['slope']:+.4f}",
                "" if pandas.isna(row["p_slope"]) else f"{row['p_slope']:.2g}",
            ]
        )
    return table(["test", "specimens", "b", "M", "slope", "p-value"], rows, range(1, 6))


def _ratio(tables: Mapping[str, pandas.DataFrame], ratio: Mapping[str, float]) -> str:
    compression = float(tables["strength"].set_index("test").loc[REFERENCE, "M"])
    nakai = 3.0 / (3.0 + compression)  # (3 - sin phi)/(3 + sin phi) with sin phi = 3 M_c/(6 + M_c)
    model = tables["model_strength"]["M"].to_numpy(dtype=float)
    measured = ratio["ratio"]
    return (
        f"**M_e/M_c = {measured:.3f} ± {ratio['within']:.3f}** (95 %, {ratio['specimens']} specimens, each tested in "
        f"both directions). The model with Table 2: {model[-1] / model[0]:.3f}. Matsuoka and Nakai, through the "
        f"measured compression strength: {nakai:.3f}."
    )


def _engines(frame: pandas.DataFrame) -> list[str]:
    tested = frame["corrected"].notna()
    resolved = frame[tested & (frame["corrected"] < SIGNIFICANT)]
    wide = {
        name: frame.pivot_table(index="test", columns="quantity", values=name)
        for name in ("engines", "between_specimens")
    }
    rows = []
    for test in dict.fromkeys(frame["test"]):
        pairs = [(wide["engines"].loc[test, q], wide["between_specimens"].loc[test, q]) for q in QUANTITIES]
        rows.append([test, *(f"{a:.2g} / {b:.2g}" for a, b in pairs)])
    names = ", ".join(f"{row.test} ({row.quantity}: {row.difference:+.2g})" for row in resolved.itertuples()) or "none"
    return [
        "## YADE and `fused`",
        f"{int(frame['specimens'].max())} specimens of 500 grains on each path, same contact law (`engines.yaml`). "
        "Root mean square along the test of the difference between the engines from the same specimen / between two "
        "specimens on one engine:",
        table(["test", *QUANTITIES.values()], rows, range(1, 1 + len(QUANTITIES))),
        f"Differences of the means over the last quarter that are resolved ({int(tested.sum())} paired t-tests, "
        f"corrected after Benjamini and Hochberg): {names}.",
    ]


def _liquefaction(frame: pandas.DataFrame) -> list[str]:
    rows = [
        [
            f"{row.specimen}, {row.engine}",
            *(
                f"{getattr(row, name):.2f}"
                for name in ("cycles_to_ratio", "cycles_to_double_amplitude", "largest_ratio")
            ),
            f"{row.Z_start:.2f} / {row.Z_liquefied:.2f}",
            f"{row.F_start:.3f} / {row.F_liquefied:.3f}",
        ]
        for row in frame.itertuples()
    ]
    header = [
        "run",
        "cycles to r_u > 0.95",
        "cycles to 5 % double amplitude",
        "largest r_u",
        "Z start / liquefied",
        "F start / liquefied",
    ]
    return [
        "## Undrained cycles to liquefaction",
        "![liquefaction](liquefaction.png)",
        "Constant volume, q = ±120 kPa, p_0 = 200 kPa.",
        table(header, rows, range(1, 6)),
    ]
