"""`labkit export`: tables of a run or a snapshot, and files for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from labkit.cli.arguments import one_of
from labkit.cli.registry import command
from labkit.errors import InputError
from labkit.exchange.formats import FORMATS
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_provenance, write_with_provenance

if TYPE_CHECKING:
    import pandas

    from labkit.micro.snapshot import Snapshot

TABLES = ("records", "contacts", "grains")


def export_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit export`."""
    parser.add_argument("run", metavar="FILE", help="run or state file")
    parser.add_argument(
        "--snapshot",
        type=int,
        metavar="N",
        help="write this snapshot of a run instead of its records; a negative number counts from the end",
    )
    parser.add_argument(
        "--table",
        type=one_of(TABLES),
        help=f"table to write, one of {', '.join(TABLES)} (default: records, or contacts of a snapshot)",
    )
    writers = [name for name in FORMATS if FORMATS[name]().writes]
    parser.add_argument(
        "--format",
        type=one_of(("csv", *writers)),
        help=f"format, one of csv, {', '.join(writers)} (default: by the ending of the file name, else csv)",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="file to write (default: CSV next to the file)")


@command("export", export_options)
def do_export(options: argparse.Namespace, argv: list[str]) -> None:
    """Writes a table whose header has names and units, or a file of another program. Raises InputError."""
    from labkit.runs.dataset import open_run

    kind = labkit_kind(options.run) if Path(options.run).is_file() else None
    if kind != "state":
        open_run(options.run).close()  # says what is wrong with any other file
    if options.output is not None and labkit_kind(options.output) is not None:
        require_writable(options.output)  # says that it would be overwritten
    written = options.format or ("csv" if options.output is None or options.output.lower().endswith(".csv") else None)
    if options.table and written != "csv":
        raise InputError(
            f"is for CSV files, not for {written or options.output}: leave it out", field="table", value=options.table
        )
    if written == "csv":
        _write_table(options, kind or "run")
    else:
        _write_format(options, kind or "run")


def _write_table(options: argparse.Namespace, kind: str) -> None:
    """Writes records, or contacts or grains of a snapshot, as CSV."""
    from labkit.exchange.grain_table import contact_table, grain_table
    from labkit.runs.dataset import open_run

    chosen = options.table or ("records" if kind == "run" and options.snapshot is None else "contacts")
    frame: pandas.DataFrame
    if chosen == "records":
        if kind == "state" or options.snapshot is not None:
            raise InputError("are those of a whole run: give a run file without --snapshot, or --table contacts")
        frame, content, ending = open_run(options.run).lab.to_dataframe(units=True), "records", ""
    else:
        snapshot = _snapshot(options, kind)
        frame = grain_table(snapshot) if chosen == "grains" else contact_table(snapshot)
        content, ending = chosen, f".{chosen}" if kind == "state" or chosen == "grains" else ""
        if kind == "run":
            content, ending = f"{chosen} of snapshot {snapshot.number}", f".snapshot{snapshot.number}{ending}"
    name = Path(options.run).name.removesuffix(".run.nc").removesuffix(".state.nc")
    output = options.output or str(Path(options.run).with_name(f"{name}{ending}.csv"))
    require_writable(output)
    write_with_provenance(output, frame.to_csv(index=False), [options.run])
    print(f"{output}: {len(frame)} {content}, {len(frame.columns)} columns")


def _write_format(options: argparse.Namespace, kind: str) -> None:
    """Writes the grains and contacts in the format of another program, or a whole run as Zarr."""
    from labkit.exchange.formats import format_to_write
    from labkit.exchange.importing import state_of
    from labkit.exchange.zarr_store import ZarrStore, write_dataset
    from labkit.runs.dataset import open_run

    if options.output is None:
        raise InputError("is missing: give the file to write", field="output")
    output = Path(options.output)
    found = format_to_write(output, options.format)
    if isinstance(found, ZarrStore) and kind == "run" and options.snapshot is None:
        write_dataset(open_run(options.run), output)
        print(f"{output}: the whole run, format {found.name}")
        return
    if not isinstance(found, ZarrStore):
        require_writable(output)
    if kind == "state":
        from labkit.dem.state import read_state

        state = read_state(options.run)
    else:
        state = state_of(_snapshot(options, kind))
    found.write(state, output)
    write_provenance(output, [options.run]) if output.is_file() else None
    print(f"{output}: {state.number_of_grains} grains, {len(state.contact_grain)} contacts, format {found.name}")


def _snapshot(options: argparse.Namespace, kind: str) -> Snapshot:
    """The chosen snapshot of a run, the last by default, or the grains of a state file."""
    from labkit.runs.dataset import open_run, require_snapshots, snapshots

    if kind == "state":
        return next(iter(snapshots(options.run, [] if options.snapshot is None else [options.snapshot])))
    run = open_run(options.run)
    number = -1 if options.snapshot is None else options.snapshot
    require_snapshots(run, options.run, [number], ", or leave --snapshot out to export its records")
    return run.lab.snapshot(number)
