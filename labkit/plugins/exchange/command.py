"""`labkit import`, `export`, `paraview` and `statistics`: files of other programs, and tables of runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from labkit.cli.arguments import History, Instance, Made, Option, ParameterTexts, Texts, one_of, require
from labkit.cli.outputs import name_beside, tell_replaced
from labkit.cli.parser import name_list
from labkit.cli.registry import command
from labkit.cli.simulate import MATERIAL
from labkit.errors import InputError, notice
from labkit.files.atomic import require_no_link
from labkit.files.netcdf import labkit_kind
from labkit.files.provenance import write_provenance, write_with_provenance
from labkit.files.writable import make_folder, require_different, require_writable
from labkit.grains.scene import MADE_WITH, Scene
from labkit.plugins.exchange.formats import FORMATS, writers
from labkit.plugins.exchange.packing import Answers
from labkit.plugins.exchange.paraview import HINT, require_h5py, write_series
from labkit.process.interruption import only_writer
from labkit.simulation.reports import one_line
from labkit.text.foreign import Doubt, require_accepted

if TYPE_CHECKING:
    import pandas

    from labkit.micro.snapshot import Snapshot
    from labkit.plugins.exchange.joining import Imported

Grains = Annotated[str, Option("file with grains, and with contacts if its format has them")]


def _say(findings: Sequence[Doubt], accepted: bool) -> None:
    """Print the findings that do not stop the command: all if `accepted`, otherwise all that are not serious."""
    for finding in findings:
        if accepted or not finding.serious:
            notice(f"note: {finding}")


@dataclasses.dataclass(frozen=True, kw_only=True)
class Foreign:
    """Information that the user gives about a file of another program."""

    contacts: Annotated[str | None, Option("file that lists the contacts, if FILE does not", "FILE")] = None
    format: Annotated[
        str | None, Option("format of FILE (default: recognised by its content)", "FORMAT", type=one_of(FORMATS))
    ] = None
    answers: Annotated[Texts, ParameterTexts(Answers, "what a file does not say")]
    accept: Annotated[bool, Option("go on in spite of serious findings of the checks")] = False

    def read(self, file: str) -> Imported:
        """Read the file, and print what the checks find. Raises InputError for serious findings, unless accepted."""
        from labkit.plugins.exchange.importing import read

        imported = read(file, self.contacts, self.format, **self.answers)
        _say(imported.findings, self.accept)
        require_accepted(imported.findings, self.accept, "imports")
        return imported

    def inputs(self, file: str) -> list[str]:
        """Return the names of the files that are read."""
        return [name for name in (file, self.contacts) if name]


def list_of_formats(words: Collection[str]) -> str:
    """List the formats that can be read, for the end of the help."""
    formats = {name: FORMATS[name]() for name in FORMATS}
    readable = {name: each.description for name, each in formats.items() if each.can("read", "read_contacts")}
    return name_list("format", readable)


@command("import", epilog=list_of_formats)
def import_command(
    file: Grains,
    *,
    foreign: Annotated[Foreign, Made(Foreign)],
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
    from labkit.files.provenance import provenance_json
    from labkit.grains.state_file import write_state
    from labkit.plugins.exchange.importing import other_stress, unrest

    output = require(output, "output", "a state file, e.g. -o mine.state.nc")
    require_writable(output, "state")
    with only_writer(Path(output)):
        imported = foreign.read(file)
        tell_replaced(output)
        state = imported.state(scene)
        _say([Doubt(text) for text in (other_stress(imported, state), unrest(state)) if text], foreign.accept)
        provenance = provenance_json(history, foreign.inputs(file), output)
        write_state(output, state.replace(history=history, provenance=provenance, engine="import"))
    origin = "contacts of the file" if imported.listed else "contacts found from overlaps, history zero"
    print(f"{output}: {one_line(state)}; {origin}")
    material = f"friction {scene.friction:g}, rolling friction {scene.rolling_friction:g}, law {scene.law}, "
    print(f"{output}: material, from the options: {material}E {scene.young_modulus:.4g} Pa, {scene.density:g} kg/m3")


@command("statistics", epilog=list_of_formats)
def statistics_command(
    file: Grains,
    *,
    foreign: Annotated[Foreign, Made(Foreign)],
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

    Prints them. The file comes from labkit or another program. Options and checks are as for `labkit import`.

    Example:
        labkit statistics grains.dump --contacts contacts.local --contact-columns id1,id2,-,fx,fy,fz,- --json s.json
    """
    from labkit.plugins.exchange.summary import as_csv, as_json, as_text, snapshot_quantities

    for name in require_different(csv, json):
        require_writable(name, inputs=foreign.inputs(file))
    if Path(file).is_file() and labkit_kind(file) in ("state", "run"):
        from labkit.results.dataset import snapshots

        numbers = [snapshot] * (labkit_kind(file) == "run")
        grains = next(iter(snapshots(file, numbers)))
    else:
        imported = foreign.read(file)
        grains = imported.snapshot(scene)
        if imported.normal_force is None:
            text = f"no contact forces in the file: normal forces are those of the {scene.law} law, tangential ones "
            print(f"{file}: {text}{'those of the file' if imported.tangential_force.any() else 'zero'}")
    values = snapshot_quantities(grains)
    print(as_text(values))
    for output, written in ((csv, as_csv), (json, as_json)):
        if output:
            write_with_provenance(output, written(values), foreign.inputs(file))


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
    program, chosen by the ending of its name: of a run, all snapshots as extended XYZ, and otherwise the last one
    (`labkit paraview` writes all for ParaView).

    Examples:
        labkit export r.run.nc -o r.csv
        labkit export r.run.nc --snapshot -1 --table grains
        labkit export s.state.nc -o s.data         # LAMMPS
        labkit export r.run.nc -o r.xyz            # OVITO, all snapshots
        labkit export s.state.nc -o s.vtkhdf       # ON-DEM
        labkit export s.state.nc -o load_s.py      # a script for YADE
        labkit export s.state.nc -o s.state.npz    # the page of `labkit page`
    """
    from labkit.results.dataset import open_run

    kind = labkit_kind(run) if Path(run).is_file() else None
    if kind != "state":
        open_run(run).close()  # raises an error that says what is wrong with any other file
    if output is not None and labkit_kind(output) is not None:
        require_writable(output)  # raises an error if a simulation would be overwritten
    written = format or ("csv" if output is None or output.lower().endswith(".csv") else None)
    if table and written != "csv":
        raise InputError(f"is for CSV files, not for {written or output}: leave it out", field="table", value=table)
    if written == "csv":
        _write_table(run, kind or "run", snapshot, table, output)
    else:
        _write_format(run, kind or "run", snapshot, format, output)


def _write_table(run: str, kind: str, number: int | None, table: str | None, output: str | None) -> None:
    """Write the records of a run, or the contacts or grains of a snapshot, as CSV."""
    from labkit.plugins.exchange.summary import contact_table, grain_table
    from labkit.results.dataset import open_run

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
    output = output or name_beside(run, f"{ending}.csv")
    require_writable(output)
    if chosen != "records" and snapshot.clumps is not None:
        _say([Doubt(f"the grains of {output} are clumps, each as a sphere of equal volume")], True)
    write_with_provenance(output, frame.to_csv(index=False), [run])
    print(f"{output}: {len(frame)} {content}, {len(frame.columns)} columns")


def _write_format(run: str, kind: str, number: int | None, format: str | None, output: str | None) -> None:
    """Write the grains and contacts in the format of another program."""
    from labkit.grains.state_file import read_state
    from labkit.plugins.exchange.formats import format_to_write
    from labkit.results.dataset import open_run

    if output is None:
        raise InputError("is missing: give the file to write", field="output")
    file = Path(output)
    writer = format_to_write(file, format)
    require_writable(file)
    frames = 0 if kind == "state" else open_run(run).lab.number_of_snapshots
    if frames and number is None and writer.can("write_frames"):
        states = [read_state(run, snapshot=k) for k in range(frames)]
        instant, state = f"{frames} snapshots", states[-1]
        writer.write_frames(states, file)
    else:
        state = read_state(run, snapshot=(-1 if number is None else number) if kind == "run" else number)
        instant = (
            "" if kind == "state" else f"the last of {frames} snapshots" if number is None else f"snapshot {number}"
        )
        writer.write(state, file)
    if state.bodies is not None and not writer.keeps_clumps:
        _say([Doubt(f"{output} has the spheres of the clumps, but not which of them form a clump")], True)
    if labkit_kind(file) is None:  # files of labkit contain their provenance
        write_provenance(file, [run])
    contacts = f"{len(state.contact_grain)} contacts" if writer.keeps_contacts else "without contacts"
    print(f"{output}: {', '.join(filter(None, (state.contents, instant, contacts)))}, format {writer.name}")


def _snapshot(file: str, kind: str, number: int | None) -> Snapshot:
    """Return a snapshot of a run, by default the last, or the grains of a state file as a Snapshot."""
    from labkit.results.dataset import open_run, snapshots

    if kind == "state":
        return next(iter(snapshots(file, None if number is None else [number])))
    run, number = open_run(file), -1 if number is None else number
    run.lab.require_snapshots([number], ", or leave --snapshot out to export its records")
    return run.lab.snapshot(number)


@command("paraview")
def paraview_command(
    file: Annotated[str, Option("state or run file")],
    *,
    snapshot: Annotated[
        list[int] | None,
        Option("snapshots of a run to write; negative numbers count from the end (default: all)", "N", type=int),
    ] = None,
    output: Annotated[str | None, Option("folder to write to (default: next to the file)", "FOLDER")] = None,
) -> None:
    """Writes grains, contacts and cell of all snapshots into one file that ParaView opens, snapshots.vtkhdf.

    Example:
        labkit paraview r.run.nc -o r_paraview
    """
    from labkit.results.dataset import snapshots

    require_h5py()
    chosen = snapshots(file, snapshot)
    default = name_beside(file, ".paraview")
    if output is None:
        require_no_link(default)
    folder = make_folder(output or default, "-o")
    print(write_series(chosen, Path(folder) / "snapshots.vtkhdf"), HINT, sep="\n")
