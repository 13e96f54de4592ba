"""The page of the study: scatter, bias, and how near to the critical state."""

from __future__ import annotations

from collections.abc import Mapping

import pandas

from analysis.markdown import table
from analysis.paper.estimates import text
from analysis.size_scatter.sizes import SMALL
from analysis.size_scatter.stored import PREFIX
from labkit.model import Parameters

INTRODUCTION = """# Scatter and bias against the number of grains

CV tests of medium density (e = 0.67) on specimens of 500 to 14,000 grains, each with its own random packing. The
campaign is `analysis/size_scatter/campaign.yaml`; its runs are made by `./lab size-scatter FOLDER`, which can be
interrupted and resumed, and this page was written by `{command}`.

{done} of the {planned} tests, and {stored} that other studies have stored: {numbers}. The stored tests are slower (I
of 1e-4 to 2.5e-4 instead of 1e-3, which is above the paper's bound of 3e-4), and those of the paper's campaign are
cubes instead of cells twice as high as wide. The state of a test is its mean over {begin:.0f} to {end:.0f} % of
strain. In a CV test e is given (the reported e varies by the volume of the overlaps only), so that the scatter of the
critical void ratio appears in Lambda: at the same Lambda, e scatters by that of Lambda divided by c_cLambda, 0.1.
p-values are corrected for the number of rows of their table (Holm)."""

SCATTER = """## Scatter

![sizes](sizes.png)

Standard deviation of one specimen ([sizes.csv](sizes.csv)), and the exponent of scatter = c N^-exponent with its 95 %
interval; p: that the exponent is 1/2, as for a mean over independent grains. `scatter`: of a specimen of 1,000
grains, in % of the mean, with the exponent 1/2; `grains for 1 %`: number at which one specimen scatters by 1 %."""

BIAS = """## Bias

y = y_infinite + k N^-power over all specimens, each weighted with its number of grains. `bias`: of 1,000 grains;
`agrees`: the whole interval is within 1 % of y_infinite."""

C0_ERROR = """## Error of C0

CV tests to 40 % of strain, 101 records of each; tests whose C0 was not stored are left out. `norm`: the largest error
of a test in the Frobenius norm, mean over the specimens with its 95 % interval; `largest`: of all tests; `below 2 %`:
tests whose largest error is below the limit of `labkit verify`; `q`: mean relative error of q from 1 % of strain on,
with its interval and the standard deviation of one specimen."""

DRIFT = """## How near to the critical state

![drift](drift.png)

Slopes within the window per 10 % of strain, over all specimens. M, A and F fall until about 70 % of strain ([the
critical state](../critical_state/README.md)): what is compared here is the state at the same strain. The small
specimens are sheared faster than the large ones: a bias could be an effect of the rate, or hide one. At I of 1e-3 and
2.5e-4 no difference is resolved ([other grains](../constants/README.md))."""

STORED = """## Slow and fast tests

Tests of 4,000 grains of the campaign minus the stored ones (Welch): the inertial number, and the height of the cell."""


def page(tables: Mapping[str, pandas.DataFrame], planned: int, window: tuple[float, float], command: str) -> str:
    """README.md of the study; planned: number of tests in the campaign; window: of strain."""
    ends = tables["ends"]
    stored = int((ends["test"] == PREFIX).sum())
    counts = ends.groupby("size", sort=False)["run"].count()
    parts = [
        INTRODUCTION.format(
            command=command,
            done=len(ends) - stored,
            stored=stored,
            planned=planned,
            numbers=", ".join(f"{n} of {size[1:]} grains" for size, n in counts.items()),
            begin=100 * window[0],
            end=100 * window[1],
        ),
        SCATTER,
        _sizes(tables["sizes"]),
        _scatter(tables["scatter"]),
        _void_ratio(tables["scatter"], tables["sizes"]),
        BIAS,
        _bias(tables["bias"]),
        C0_ERROR,
        _c0_error(tables["c0_error"]),
        DRIFT,
        _drift(tables["stationarity"]),
    ]
    if tables["stored"]["specimens"].any():
        parts += [STORED, _stored(tables["stored"])]
    return "\n\n".join(parts) + "\n"


def _sizes(rows: pandas.DataFrame) -> str:
    names = list(dict.fromkeys(rows["size"]))
    body = []
    for quantity, group in rows.groupby("quantity", sort=False):
        known = group.set_index("size")
        cells = [text(known.loc[name, "scatter"], digits=2) for name in names]
        body.append([str(quantity), text(group["mean"].iloc[-1]), *cells])
    return table(["quantity", "mean", *(f"scatter, {name[1:]}" for name in names)], body)


def _scatter(rows: pandas.DataFrame) -> str:
    body = [
        [
            row.quantity,
            text(row.exponent, row.within),
            f"{row.corrected:.2g}",
            f"{100 * row.relative:.2g} %",
            f"{row.needed:.2g}",
        ]
        for row in rows.itertuples()
    ]
    return table(["quantity", "exponent", "p", f"scatter at {SMALL}", "grains for 1 %"], body)


def _void_ratio(scatter: pandas.DataFrame, sizes: pandas.DataFrame) -> str:
    """Scatter of the critical void ratio at given Lambda, from that of Lambda."""
    relative = float(scatter.set_index("quantity").loc["Lambda", "relative"])
    mean = float(sizes[sizes["quantity"] == "Lambda"]["mean"].iloc[-1])
    e = relative * mean / Parameters().c_cLam
    rows = ", ".join(f"{e * (SMALL / grains) ** 0.5:.2g} with {grains}" for grains in (1000, 4000, 14000, 110000))
    return f"Scatter of the critical void ratio at given Lambda, with N^-1/2: {rows} grains."


def _bias(rows: pandas.DataFrame) -> str:
    body = [
        [
            row.quantity,
            row.power,
            text(row.infinite, row.infinite_within),
            text(row.bias, row.within),
            f"{100 * row.relative:.1f} %",
            f"{row.corrected:.2g}",
            row.verdict,
        ]
        for row in rows.itertuples()
    ]
    return table(["quantity", "power", "y_infinite", f"bias at {SMALL}", "relative", "p", "verdict"], body)


def _c0_error(rows: pandas.DataFrame) -> str:
    body = [
        [
            f"{row.grains:,.0f}",
            str(row.specimens),
            text(100 * row.norm, 100 * row.norm_within) + " %",
            f"{100 * row.norm_largest:.2f} %",
            f"{row.below} of {row.specimens}",
            text(100 * row.q, 100 * row.q_within) + " %",
            f"{100 * row.q_scatter:.2g} %",
        ]
        for row in rows.itertuples()
    ]
    return table(["grains", "specimens", "norm", "largest", "below 2 %", "q", "scatter of q"], body)


def _drift(rows: pandas.DataFrame) -> str:
    body = [
        [row.quantity, str(row.specimens), text(row.slope, row.within), f"{row.corrected:.2g}", row.verdict]
        for row in rows.itertuples()
    ]
    return table(["quantity", "specimens", "slope", "p", "verdict"], body)


def _stored(rows: pandas.DataFrame) -> str:
    body = [
        [row.quantity, text(row.mean), text(row.difference, row.within), str(row.specimens), f"{row.corrected:.2g}"]
        for row in rows.itertuples()
    ]
    return table(["quantity", "stored", "difference", "specimens", "p"], body)
