"""`labkit export`: tables of a run or a snapshot, and files for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import Option, one_of
from labkit.cli.outputs import stem
from labkit.cli.registry import command
from labkit.errors import InputError
from labkit.exchange.formats import writers
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_provenance, write_with_provenance

if TYPE_CHECKING:
    import pandas

    from labkit.micro.snapshot import Snapshot

TABLES = ("records", "contacts", "grains")


@command("export")
def export_command(
    run: Annotated[str, Option("run or state file", "FILE")],
    *,
    snapshot: Annotated[
        int | None,
        Option("write this snapshot of a run instead of its records; a negative number counts from the end", type=int),
    ] = None,
    table: Annotated[
        str | None,
        Option(
            f"table to write, one of {', '.join(TABLES)} (default: records, or contacts of a snapshot)",
            type=one_of(TABLES),
        ),
    ] = None,
    format: Annotated[
        str | None,
        Option(
            f"format, one of csv, {', '.join(writers())} (default: by the ending of the file name, else csv)",
            type=one_of(("csv", *writers())),
        ),
    ] = None,
    output: Annotated[str | None, Option("file to write (default: CSV next to the file)", "FILE")] = None,
) -> None:
    """Writes the records of a run, or the contacts or grains of one snapshot or of a state file.

    The file is CSV with the unit of each column in the header; or it has grains and contacts in the format of another
    program, chosen by the ending of its name.

    Examples:
        labkit export r.run.nc -o r.csv
        labkit export r.run.nc --snapshot -1 --table grains
        labkit export s.state.nc -o s.data         # LAMMPS
        labkit export s.state.nc -o s.vtkhdf       # ON-DEM
        labkit export s.state.nc -o load_s.py      # a script for YADE
        labkit export r.run.nc -o r.zarr
    """
    from labkit.runs.dataset import open_run

    kind = labkit_kind(run) if Path(run).is_file() else None
    if kind != "state":
        open_run(run).close()  # says what is wrong with any other file
    if output is not None and labkit_kind(output) is not None:
        require_writable(output)  # says that it would be overwritten
    written = format or ("csv" if output is None or output.lower().endswith(".csv") else None)
    if table and written != "csv":
        raise InputError(f"is for CSV files, not for {written or output}: leave it out", field="table", value=table)
    if written == "csv":
        _write_table(run, kind or "run", snapshot, table, output)
    else:
        _write_format(run, kind or "run", snapshot, format, output)


def _write_table(run: str, kind: str, number: int | None, table: str | None, output: str | None) -> None:
    """Write records, or contacts or grains of a snapshot, as CSV."""
    from labkit.exchange.summary import contact_table, grain_table
    from labkit.runs.dataset import open_run

    chosen = table or ("records" if kind == "run" and number is None else "contacts")
    frame: pandas.DataFrame
    if chosen == "records":
        if kind == "state" or number is not None:
            raise InputError("are those of a whole run: give a run file without --snapshot, or --table contacts")
        frame, content, ending = open_run(run).lab.to_dataframe(units=True), "records", ""
    else:
        snapshot = _snapshot(run, kind, number)
        frame = grain_table(snapshot) if chosen == "grains" else contact_table(snapshot)
        content, ending = chosen, f".{chosen}" if kind == "state" or chosen == "grains" else ""
        if kind == "run":
            content, ending = f"{chosen} of snapshot {snapshot.number}", f".snapshot{snapshot.number}{ending}"
    output = output or str(Path(run).with_name(f"{stem(run)}{ending}.csv"))
    require_writable(output)
    write_with_provenance(output, frame.to_csv(index=False), [run])
    print(f"{output}: {len(frame)} {content}, {len(frame.columns)} columns")


def _write_format(run: str, kind: str, number: int | None, format: str | None, output: str | None) -> None:
    """Write the grains and contacts in the format of another program, or a whole run as Zarr."""
    from labkit.exchange.formats import format_to_write
    from labkit.exchange.zarr_store import ZarrStore, write_dataset
    from labkit.grains.state import read_state
    from labkit.runs.dataset import open_run

    if output is None:
        raise InputError("is missing: give the file to write", field="output")
    file = Path(output)
    found = format_to_write(file, format)
    if isinstance(found, ZarrStore) and kind == "run" and number is None:
        write_dataset(open_run(run), file)
        print(f"{output}: the whole run, format {found.name}")
        return
    if not isinstance(found, ZarrStore):
        require_writable(file)
    state = read_state(run, snapshot=(-1 if number is None else number) if kind == "run" else number)
    found.write(state, file)
    write_provenance(file, [run]) if file.is_file() else None
    print(f"{output}: {state.number_of_grains} grains, {len(state.contact_grain)} contacts, format {found.name}")


def _snapshot(file: str, kind: str, number: int | None) -> Snapshot:
    """Return the chosen snapshot of a run, the last by default, or the grains of a state file."""
    from labkit.runs.dataset import open_run, require_snapshots, snapshots

    if kind == "state":
        return next(iter(snapshots(file, [] if number is None else [number])))
    run, number = open_run(file), -1 if number is None else number
    require_snapshots(run, file, [number], ", or leave --snapshot out to export its records")
    return run.lab.snapshot(number)
