"""`labkit export`: the records of a run, or the contacts of one snapshot, as CSV."""

from __future__ import annotations

import argparse
from pathlib import Path

from labkit.cli.registry import command
from labkit.io.files import require_writable
from labkit.io.provenance import write_with_provenance


def export_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit export`."""
    parser.add_argument("run", metavar="RUN", help="run file")
    parser.add_argument(
        "--snapshot",
        type=int,
        metavar="N",
        help="write the contacts of this snapshot instead of the records; a negative number counts from the end",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="CSV file to write (default: next to the run file)")


@command("export", export_options)
def do_export(options: argparse.Namespace, argv: list[str]) -> None:
    """Write a CSV file whose header gives the name and unit of each column. Raises InputError."""
    import labkit
    from labkit.runs.dataset import require_snapshots

    run = labkit.open_run(options.run)
    ending = ".csv"
    if options.snapshot is None:
        frame, content = run.lab.to_dataframe(units=True), "records"
    else:
        require_snapshots(run, options.run, [options.snapshot], ", or leave --snapshot out to export its records")
        number = range(run.lab.number_of_snapshots)[options.snapshot]
        frame, content = run.lab.contacts_table(number, units=True), f"contacts of snapshot {number}"
        ending = f".snapshot{number}.csv"
    output = options.output or str(Path(options.run).with_name(Path(options.run).name.removesuffix(".run.nc") + ending))
    require_writable(output)
    write_with_provenance(output, frame.to_csv(index=False), [options.run])
    print(f"{output}: {len(frame)} {content}, {len(frame.columns)} columns")
