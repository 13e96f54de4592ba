"""`labkit verify`, `critical` and `info`: print checks, critical states and the contents of files."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import Csv, Option, strain
from labkit.cli.outputs import name_beside, require_outputs, write_outputs
from labkit.cli.registry import command
from labkit.files.provenance import write_with_provenance

if TYPE_CHECKING:
    import xarray


@command("verify")
def verify_command(
    run: Annotated[list[str], Option("run file")],
    *,
    output: Annotated[str | None, Option("figure to write (default: next to the first run file)", "FILE")] = None,
    rows: Annotated[int, Option("number of rows of the table")] = 20,
    csv: Annotated[str | None, Option("also write the checks and limits as CSV, to this file", "FILE")] = None,
) -> int:
    """Compares the stress that C0 predicts with Love's stress, and checks the energy balance and the held quantities.

    Prints a table and the checks, which docs/verify.md explains, and writes a figure. Exit code 1 if a check fails.

    Example:
        labkit verify r.run.nc --csv checks.csv
    """
    from labkit.figures import plots
    from labkit.results import verify

    runs = runs_by_name(run)
    verify.require_simulations(runs)
    figure = output or name_beside(run[0], ".verify.png")
    require_outputs(figure, csv)
    findings = {name: verify.findings(each) for name, each in runs.items()}
    for name, each in runs.items():
        print(
            f"{name}: path {each.attrs['path']}, {each.lab.contents}, {each.sizes['time']} records"
            + ("" if each.attrs["complete"] else ", not complete yet")
        )
        print(verify.findings_table(each, rows))
        print(findings[name])
    plots.save(plots.sff_against_love(runs), figure, run)
    print(f"figure: {figure}")
    if csv:
        write_with_provenance(csv, verify.findings_csv(findings), run)
    return 0 if all(f.holds for lines in findings.values() for f in lines if f.decides) else 1


@command("critical")
def critical_command(
    run: Annotated[list[str], Option("run file")],
    *,
    min_strain: Annotated[
        float | None,
        Option(
            "strain that a test must reach to be included: gamma_xz in simple shear, else axial (default: 0.15)",
            "STRAIN",
            type=strain,
        ),
    ] = None,
    output: Annotated[str, Option("figure to write", "FILE")] = "critical.png",
    csv: Csv = None,
) -> None:
    """Averages the last quarter of each shear test, and says whether it is shown to be a critical state.

    It is if the 95 % intervals of the slopes of e, q/p and p stay below 1 % of their means per 10 % strain. Prints a
    table, the critical-state line if p differs enough (e_c, with the half-width of its 95 % interval from three tests
    on), and writes a figure: e and q against p, and the state parameter.

    Example:
        labkit critical cv.run.nc cp.run.nc --csv critical.csv
    """
    from labkit.figures.critical_figure import ends_of_tests
    from labkit.results.critical import (
        ENOUGH_STRAIN,
        critical_states,
        line_of,
        mean_strengths,
        require_critical,
        verdicts,
    )

    opened = runs_by_name(run)
    runs, left_out = require_critical(opened, ENOUGH_STRAIN if min_strain is None else min_strain)
    files = [file for file, name in zip(run, opened, strict=True) if name in runs]
    require_outputs(output, csv)
    print(*(f"left out: {name}: {reason}\n" for name, reason in left_out.items()), sep="", end="")
    table = critical_states(runs)
    if (line := line_of(table)) is not None:
        p = 1e6 * table["p_MPa"]
        table = table.assign(e_c=line[0].void_ratio(p), e_c_within=line[0].within(p))
    print(table.to_string(index=False, float_format="%.4g"))
    print(*mean_strengths(runs, table), *verdicts(table), *([] if line is None else [line[1]]), sep="\n")
    write_outputs(ends_of_tests(runs, table, line), output, table, csv, files)


@command("info")
def info_command(
    file: Annotated[str, Option("state file, run file, or any other file that labkit wrote")],
    *,
    check: Annotated[bool, Option("recompute the hashes of its data and of its input files")] = False,
) -> int:
    """Prints the contents of a state, run or probes file, and how it was made: command, versions, computer, inputs.

    Exit code 1 if a hash does not match.

    Examples:
        labkit info r.run.nc --check
    """
    from labkit.results.info import check_file, describe_file

    print(describe_file(file))
    if not check:
        return 0
    lines, same = check_file(file)
    print("hashes", *lines, sep="\n")
    return 0 if same else 1


def runs_by_name(files: Sequence[str]) -> dict[str, xarray.Dataset]:
    """Open runs in the order given, name -> run; a name is the file name, or the full path if it is not unique."""
    from labkit.results.dataset import open_run, short_names

    return {name: open_run(file) for name, file in zip(short_names(files), files, strict=True)}
