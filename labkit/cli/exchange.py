"""`labkit import` and `labkit statistics`: grains and contacts of other programs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from labkit.cli.arguments import add_parameters, given, one_of, require
from labkit.cli.parser import Parser, listed
from labkit.cli.registry import command
from labkit.cli.simulate import described, history_of
from labkit.dem.scene import MADE_WITH, Scene
from labkit.exchange.answers import Answers
from labkit.exchange.checks import Finding
from labkit.exchange.formats import FORMATS
from labkit.io.files import require_writable
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_with_provenance


def reading_options(parser: argparse.ArgumentParser) -> None:
    """Options that say what a file does not."""
    parser.add_argument("file", metavar="FILE", help="file with grains, and with contacts if its format has them")
    parser.add_argument("--contacts", metavar="FILE", help="file that lists the contacts, if FILE does not")
    parser.add_argument(
        "--format", type=one_of(FORMATS), metavar="FORMAT", help="format of FILE (default: recognised by its content)"
    )
    add_parameters(parser.add_argument_group("what a file does not say"), Answers)
    parser.add_argument("--accept", action="store_true", help="go on in spite of serious findings of the checks")
    if isinstance(parser, Parser) and {"-h", "--help"} & set(parser.command_line):
        formats = {name: FORMATS[name]() for name in FORMATS}
        readable = {name: each.description for name, each in formats.items() if each.reads or each.reads_contacts}
        parser.epilog = listed("format", readable)


def import_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit import`."""
    reading_options(parser)
    material = parser.add_argument_group("material, contact law and time step")
    add_parameters(material, Scene, leave_out=MADE_WITH)
    parser.add_argument("-o", "--output", metavar="FILE", help="state file to write")


@command("import", import_options)
def do_import(options: argparse.Namespace, argv: list[str]) -> None:
    """Reads grains and contacts, prints findings, and writes a state file."""
    from labkit.dem.state import write_state
    from labkit.exchange.importing import read, require_sane
    from labkit.io.provenance import provenance

    output = require(options.output, "output", "a state file, e.g. -o mine.state.nc")
    require_writable(output, "state")
    scene = Scene(**given(options, Scene))
    found = read(options.file, options.contacts, options.format, **given(options, Answers))
    _say(found.findings, options.accept)
    require_sane(found.findings, options.accept)
    state = found.state(scene)
    inputs = [name for name in (options.file, options.contacts) if name]
    made = provenance(history_of(argv), inputs, output)
    write_state(output, state.replace(history=history_of(argv), provenance=made, engine="import"))
    origin = "contacts of the file" if found.listed else "contacts found from overlaps, history zero"
    print(f"{output}: {described(state)}; {origin}")


def statistics_options(parser: argparse.ArgumentParser) -> None:
    """Options of `labkit statistics`."""
    reading_options(parser)
    parser.add_argument(
        "--snapshot", type=int, default=-1, metavar="N", help="snapshot of a run file of labkit (default: -1)"
    )
    material = parser.add_argument_group(
        "material", "E scales Lambda; the law gives the forces of grains without contact forces."
    )
    add_parameters(material, Scene, leave_out=MADE_WITH)
    parser.add_argument("--csv", metavar="FILE", help="also write the statistics as CSV, to this file")
    parser.add_argument("--json", metavar="FILE", help="also write the statistics as JSON, to this file")


@command("statistics", statistics_options)
def do_statistics(options: argparse.Namespace, argv: list[str]) -> None:
    """Prints Z, A, Lambda, F, F^t, Love's stress and C0 of one contact list."""
    from labkit.exchange.importing import read, require_sane
    from labkit.exchange.summary import as_csv, as_json, as_text, quantities

    for output in (options.csv, options.json):
        if output:
            require_writable(output)
    if Path(options.file).is_file() and labkit_kind(options.file) in ("state", "run"):
        from labkit.runs.dataset import snapshots

        numbers = [options.snapshot] * (labkit_kind(options.file) == "run")
        snapshot = next(iter(snapshots(options.file, numbers)))
    else:
        scene = Scene(**given(options, Scene))
        found = read(options.file, options.contacts, options.format, **given(options, Answers))
        _say(found.findings, options.accept)
        require_sane(found.findings, options.accept)
        snapshot = found.snapshot(scene)
        if found.normal_force is None:
            text = f"no contact forces in the file: normal forces are those of the {scene.law} law, tangential ones "
            print(f"{options.file}: {text}{'those of the file' if found.tangential_force.any() else 'zero'}")
    values = quantities(snapshot)
    print(as_text(values))
    inputs = [name for name in (options.file, options.contacts) if name]
    for output, written in ((options.csv, as_csv), (options.json, as_json)):
        if output:
            write_with_provenance(output, written(values), inputs)


def _say(findings: Sequence[Finding], accepted: bool) -> None:
    """Prints the findings that do not stop the command."""
    for finding in findings:
        if accepted or not finding.serious:
            print(f"labkit: note: {finding}", file=sys.stderr, flush=True)
