"""`labkit import` and `labkit statistics`: grains and contacts of other programs."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Annotated

from labkit.cli.arguments import History, Instance, Option, ParameterTexts, Texts, one_of, require
from labkit.cli.outputs import tell_replaced
from labkit.cli.parser import name_list
from labkit.cli.registry import command
from labkit.cli.simulate import MATERIAL, one_line
from labkit.exchange.answers import Answers
from labkit.exchange.checks import Doubt
from labkit.exchange.formats import FORMATS
from labkit.grains.scene import MADE_WITH, Scene
from labkit.io.files import require_writable
from labkit.io.interruption import only_writer
from labkit.io.netcdf import labkit_kind
from labkit.io.provenance import write_with_provenance

Grains = Annotated[str, Option("file with grains, and with contacts if its format has them")]
ContactList = Annotated[str | None, Option("file that lists the contacts, if FILE does not", "FILE")]
Format = Annotated[
    str | None, Option("format of FILE (default: recognised by its content)", "FORMAT", type=one_of(FORMATS))
]
WhatIsMissing = Annotated[Texts, ParameterTexts(Answers, "what a file does not say")]
Accept = Annotated[bool, Option("go on in spite of serious findings of the checks")]


def list_of_formats(words: Collection[str]) -> str:
    """List the formats that can be read, for the end of the help."""
    formats = {name: FORMATS[name]() for name in FORMATS}
    readable = {name: each.description for name, each in formats.items() if each.reads or each.reads_contacts}
    return name_list("format", readable)


@command("import", epilog=list_of_formats)
def import_command(
    file: Grains,
    *,
    contacts: ContactList = None,
    format: Format = None,
    answers: WhatIsMissing,
    accept: Accept = False,
    scene: Annotated[Scene, Instance(Scene, MATERIAL, leave_out=MADE_WITH)],
    output: Annotated[str | None, Option("state file to write", "FILE")] = None,
    history: History,
) -> None:
    """Reads grains, and contacts if there are any, from a file of another program.

    What the file does not say (box, units, radii or diameters, sign of forces) is asked for. Checks the grains, and
    writes them as a state file at rest; normal forces follow from the overlaps and the contact law.

    Examples:
        labkit import pack.txt --length-unit m -o mine.state.nc
        labkit import grains.csv --contacts contacts.csv --box 4,4,4 --length-unit mm --size radius --force-unit N
            --force-sign compression -o mine.state.nc
    """
    from labkit.exchange.importing import other_stress, read, require_accepted
    from labkit.grains.state import write_state
    from labkit.io.provenance import provenance_json

    output = require(output, "output", "a state file, e.g. -o mine.state.nc")
    require_writable(output, "state")
    with only_writer(Path(output)):
        found = read(file, contacts, format, **answers)
        _say(found.findings, accept)
        require_accepted(found.findings, accept)
        tell_replaced(output)
        state = found.state(scene)
        _say([Doubt(text)] if (text := other_stress(found, state)) else [], accept)
        inputs = [name for name in (file, contacts) if name]
        made = provenance_json(history, inputs, output)
        write_state(output, state.replace(history=history, provenance=made, engine="import"))
    origin = "contacts of the file" if found.listed else "contacts found from overlaps, history zero"
    print(f"{output}: {one_line(state)}; {origin}")


@command("statistics", epilog=list_of_formats)
def statistics_command(
    file: Grains,
    *,
    contacts: ContactList = None,
    format: Format = None,
    answers: WhatIsMissing,
    accept: Accept = False,
    snapshot: Annotated[int, Option("snapshot of a run file of labkit", type=int)] = -1,
    scene: Annotated[
        Scene,
        Instance(
            Scene,
            "material",
            "E scales Lambda; the law gives the forces of grains without contact forces.",
            leave_out=MADE_WITH,
        ),
    ],
    csv: Annotated[str | None, Option("also write the statistics as CSV, to this file", "FILE")] = None,
    json: Annotated[str | None, Option("also write the statistics as JSON, to this file", "FILE")] = None,
) -> None:
    """Computes Z, A, Lambda, F, F^t, Love's stress and C0 from the grains and contact forces in a file.

    The file is one of labkit or of another program. Prints them. Options and checks are those of `labkit import`.

    Example:
        labkit statistics grains.dump --contacts contacts.local --contact-columns id1,id2,-,fx,fy,fz,- --json s.json
    """
    from labkit.exchange.importing import read, require_accepted
    from labkit.exchange.summary import as_csv, as_json, as_text, snapshot_quantities

    for output in (csv, json):
        if output:
            require_writable(output)
    if Path(file).is_file() and labkit_kind(file) in ("state", "run"):
        from labkit.runs.dataset import snapshots

        numbers = [snapshot] * (labkit_kind(file) == "run")
        grains = next(iter(snapshots(file, numbers)))
    else:
        found = read(file, contacts, format, **answers)
        _say(found.findings, accept)
        require_accepted(found.findings, accept)
        grains = found.snapshot(scene)
        if found.normal_force is None:
            text = f"no contact forces in the file: normal forces are those of the {scene.law} law, tangential ones "
            print(f"{file}: {text}{'those of the file' if found.tangential_force.any() else 'zero'}")
    values = snapshot_quantities(grains)
    print(as_text(values))
    inputs = [name for name in (file, contacts) if name]
    for output, written in ((csv, as_csv), (json, as_json)):
        if output:
            write_with_provenance(output, written(values), inputs)


def _say(findings: Sequence[Doubt], accepted: bool) -> None:
    """Print the findings that do not stop the command."""
    for finding in findings:
        if accepted or not finding.serious:
            print(f"labkit: note: {finding}", file=sys.stderr, flush=True)
