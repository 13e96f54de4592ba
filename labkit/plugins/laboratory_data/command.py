"""`labkit measured`, `misfit` and `calibrate-grains`: laboratory tests, and the grains that reproduce them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated, Literal

from labkit.cli.arguments import Csv, History, Instance, Made, Option, PathOptions, Texts, list_of_paths
from labkit.cli.outputs import tell_replaced, write_table
from labkit.cli.registry import command
from labkit.cli.simulate import MATERIAL, named_path
from labkit.errors import InputError
from labkit.files.writable import require_writable, stem
from labkit.grains.scene import Scene
from labkit.parameters import parameters_of
from labkit.paths.path import Path
from labkit.plugins.laboratory_data.ags4 import require_ags4, write_ags4
from labkit.plugins.laboratory_data.comparing import CURVES, misfit
from labkit.plugins.laboratory_data.layout import Separator
from labkit.plugins.laboratory_data.posterior import calibrate_grains, posterior_of
from labkit.plugins.laboratory_data.reading import (
    SIGNS,
    STRAINS,
    STRESSES,
    UNSIGNED,
    Column,
    preview,
    read_measured,
    write_measured,
)
from labkit.plugins.laboratory_data.sampling import GrainTests, read_samples
from labkit.plugins.laboratory_data.sheet import predict_test, write_pdf
from labkit.results.run import Run

Scatter = Annotated[
    list[str],
    Option(f"standard deviation between repeated tests, SI; quantities are {', '.join(CURVES)}", "QUANTITY=NUMBER"),
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class MeasuredTable:
    """What the file of a measured test contains."""

    column: Annotated[
        list[str],
        Option(
            f"{', '.join((*STRAINS, *STRESSES, *UNSIGNED))}: header in the file (or #3 for the third column), unit and "
            "the sign that is positive in it, compression or tension (none for the last two)",
            "QUANTITY=HEADER:UNIT:SIGN",
        ),
    ]
    strain_kind: Annotated[Literal["engineering", "logarithmic"], Option("kind of strains in the file")]
    stress_kind: Annotated[Literal["effective", "total"], Option("kind of stresses in the file")]
    source: Annotated[str, Option("where the measurement was published", "TEXT")]
    licence: Annotated[str, Option("terms under which it may be used", "TEXT")]
    void_ratio: Annotated[float | None, Option("void ratio of the first row, if no column gives it", "e")] = None
    rows: Annotated[list[str] | None, Option("rows to read, if the table has several tests", "HEADER=VALUE")] = None
    ags4: Annotated[str | None, Option("group of an AGS4 file, which also has the units", "GROUP")] = None
    header: Annotated[int | None, Option("line of the headers, if several lines have them", "LINE", type=int)] = None
    separator: Annotated[Separator | None, Option("mark between columns (default: with which most are numbers)")] = None
    decimal: Annotated[Literal["point", "comma"] | None, Option("decimal mark, if the numbers do not show it")] = None
    thousands: Annotated[str | None, Option("mark between thousands, if it is an unusual one", "MARK")] = None
    encoding: Annotated[str | None, Option("encoding (default: UTF-8, UTF-16 or Windows-1252)", "NAME")] = None
    zero: Annotated[
        list[str] | None, Option("quantities counted from the first row: their first value is subtracted", "QUANTITY")
    ] = None
    accept: Annotated[
        bool, Option("leave out rows that cannot be read, and go on in spite of serious findings of the checks")
    ] = False


@command("measured", epilog=list_of_paths)
def measured_command(
    path: Annotated[str, Option("loading path that repeats the test, or a path file, FILE.yaml")],
    file: Annotated[str, Option("text table, or an AGS4 file")],
    *,
    loading: Annotated[Texts, PathOptions()],
    table: Annotated[MeasuredTable, Made(MeasuredTable)],
    output: Annotated[str, Option("run file to write", "FILE")],
    history: History,
) -> None:
    """Reads a test measured in a laboratory and writes it as a run file without grains.

    Nothing is guessed: you must give headers, units, signs and the kinds of strain and stress. Prints what was read,
    and refuses what looks wrong. `labkit figure` draws the file together with runs.

    Example:
        labkit measured cr tmd2.csv --pressure 100kPa --void-ratio 0.975 --strain-kind engineering
            --stress-kind effective --column axial_strain=eps1:%:compression volumetric_strain=epsv:%:compression
            axial_stress=s1:kPa:compression radial_stress=s3:kPa:compression --source doi:10.1007/s11440-015-0402-z
            --licence "CC BY 4.0" -o tmd2.run.nc
    """
    require_writable(output, "run")
    test = _test(path, loading)
    columns = {name: _column(name, text) for name, text in _pairs(table.column, "column").items()}
    said = vars(table) | {"rows": _pairs(table.rows or (), "rows"), "group": table.ags4, "name": stem(output)}
    for option in ("column", "ags4"):
        del said[option]
    measured = read_measured(file, test, columns, **said)
    tell_replaced(output)
    write_measured(measured, output, history)
    print(preview(measured))
    last = measured.data["axial_strain"].values[-1]
    print(f"{output}: {measured.data.sizes['time']} rows, axial strain to {last:.4g}")


def _test(path: str, loading: Texts) -> Path:
    """Return the path that the user names, with its options. Raises InputError for those of another path."""
    kind, written = named_path(path)
    for name in sorted(loading.keys() - parameters_of(kind).keys()):
        raise InputError(f"is not a parameter of {kind.name}: leave it out", field=name)
    return kind(**{**written, **loading})


def _column(name: str, text: str) -> Column:
    """Return header, unit and sign; the header may contain colons."""
    signed = name not in UNSIGNED
    header, *others = text.rsplit(":", 2 if signed or text.rpartition(":")[2] in SIGNS else 1)
    if len(others) < 1 + signed:
        pattern = "HEADER:UNIT:SIGN" if signed else "HEADER:UNIT"
        example = "axial_strain=eps1:%:compression" if signed else "pore_pressure=u:kPa"
        raise InputError(field="column", value=f"{name}={text}", allowed=f"QUANTITY={pattern}, e.g. {example}")
    unit = others[0] or None
    return (header, unit, others[1]) if len(others) > 1 else (header, unit)


def _pairs(texts: Sequence[str], field: str) -> dict[str, str]:
    """Return name -> value of NAME=VALUE. Raises InputError for another text, and for a name that stands twice."""
    pairs: dict[str, str] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise InputError(field=field, value=text, allowed="NAME=VALUE")
        if name in pairs:
            raise InputError(f"has {name} twice", field=field, value=text, allowed=f"one of {pairs[name]}, {value}")
        pairs[name] = value
    return pairs


def _numbers_by_name(texts: Sequence[str], field: str) -> dict[str, float]:
    try:
        return {name: float(value) for name, value in _pairs(texts, field).items()}
    except ValueError:
        raise InputError(field=field, value=" ".join(texts), allowed="NAME=NUMBER") from None


@command("misfit")
def misfit_command(
    run: Annotated[list[str], Option("run files")],
    *,
    measured: Annotated[str, Option("measured test, from labkit measured", "FILE")],
    scatter: Scatter,
    csv: Csv = None,
) -> None:
    """Compares runs with a measured test: root mean square of the difference, in units of the laboratory's scatter.

    Refuses runs of another path, drainage or pressure, and says which range of strain is compared.

    Example:
        labkit misfit r.run.nc --measured tmd2.run.nc --scatter stress_ratio=0.03 volumetric_strain=0.003
    """
    import pandas

    deviations, reference = _numbers_by_name(scatter, "scatter"), Run.open(measured)
    table = pandas.DataFrame([{"run": file, **misfit(Run.open(file), reference, deviations)} for file in run])
    print(table.to_string(index=False, float_format="%.3g"))
    write_table(table, csv, [*run, measured])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Sampling:
    """How many specimens a calibration makes, and how large they are."""

    samples: Annotated[int, Option("number of sets of parameters; each repeats all tests")] = 48
    grains: Annotated[int, Option("number of grains of the first specimens")] = 300
    largest: Annotated[int, Option("largest number of grains")] = 1000
    seed: Annotated[int, Option("seed of the parameters and of the specimens")] = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Calibration:
    """What a calibration is about."""

    free: Annotated[list[str], Option("parameter of the grains and its range", "PARAMETER=LOW..HIGH")]
    scatter: Scatter
    void_ratio_limits: Annotated[
        list[float] | None,
        Option("e_min and e_max of the sand, to reproduce relative densities instead of void ratios", "e"),
    ] = None

    def tests(self, measured: Sequence[str], scene: Scene) -> GrainTests:
        """Return the tests of a calibration, from files. Raises InputError."""
        ranges = {}
        for name, text in _pairs(self.free, "free").items():
            try:
                low, high = map(float, text.split(".."))
            except ValueError:
                raise InputError(field="free", value=f"{name}={text}", allowed="PARAMETER=LOW..HIGH") from None
            ranges[name] = (low, high)
        limits = self.void_ratio_limits
        if limits is not None and len(limits) != 2:
            raise InputError(field="void_ratio_limits", value=len(limits), allowed="e_min and e_max")
        runs, scatter = {stem(file): Run.open(file) for file in measured}, _numbers_by_name(self.scatter, "scatter")
        return GrainTests(runs, ranges, scatter, scene, None if limits is None else (limits[0], limits[1]))


MeasuredTests = Annotated[list[str], Option("measured tests, from labkit measured")]


@command("calibrate-grains")
def calibrate_grains_command(
    measured: MeasuredTests,
    *,
    calibration: Annotated[Calibration, Made(Calibration)],
    sampling: Annotated[Sampling, Made(Sampling)],
    scene: Annotated[Scene, Instance(Scene, MATERIAL)],
    output: Annotated[str, Option("samples, each written once computed; repeat the command to resume", "FILE")],
    csv: Csv = None,
) -> None:
    """Finds the parameters with which grains reproduce measured tests, and their uncertainty.

    Example:
        labkit calibrate-grains tmd2.run.nc tmd22.run.nc --free friction=0.1..1 rolling_friction=0.02..1
            --scatter stress_ratio=0.03 volumetric_strain=0.003 --void-ratio-limits 0.677 1.054 -o samples.jsonl
    """
    tests = calibration.tests(measured, scene)
    posterior = calibrate_grains(
        tests, **vars(sampling), file=output, progress=lambda done, text: print(text, flush=True)
    )
    failed = [sample for sample in posterior.samples if sample.failure]
    print(f"{len(posterior.samples)} samples, {len(failed)} failed" + (f", e.g. {failed[0].failure}" if failed else ""))
    table = posterior.table().rename_axis("parameter").reset_index()
    print(table.to_string(index=False, float_format="%.4g"))
    write_table(table, csv, [*measured, output])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Specimens:
    """The specimens of a predicted test."""

    void_ratio: Annotated[float, Option("void ratio of the sand", "e")]
    draws: Annotated[int, Option("number of sets of parameters, with a specimen each")] = 6
    grains: Annotated[int, Option("number of grains of a specimen")] = 300


@dataclasses.dataclass(frozen=True, kw_only=True)
class SheetFiles:
    """The files of a predicted test."""

    output: Annotated[str, Option("sheet to write, PDF", "FILE")]
    ags4: Annotated[str | None, Option("AGS4 file to write", "FILE")] = None
    csv: Csv = None


@command("predict")
def predict_command(
    path: Annotated[str, Option("loading path of the test, or a path file, FILE.yaml")],
    measured: MeasuredTests,
    *,
    loading: Annotated[Texts, PathOptions(("free", "measured"))],
    specimens: Annotated[Specimens, Made(Specimens)],
    samples: Annotated[str, Option("samples of the grains, from labkit calibrate-grains", "FILE")],
    calibration: Annotated[Calibration, Made(Calibration)],
    scene: Annotated[Scene, Instance(Scene, MATERIAL)],
    sheet: Annotated[SheetFiles, Made(SheetFiles)],
) -> None:
    """Predicts a test that was not carried out, from calibrated grains, with intervals of 90 %.

    Give the measured tests and options of the calibration again.

    Example:
        labkit predict cr tmd2.run.nc tmd22.run.nc --pressure 200kPa --strain 0.1 --void-ratio 0.816
            --free friction=0.1..1 rolling_friction=0.02..1 --scatter stress_ratio=0.03 volumetric_strain=0.003
            --void-ratio-limits 0.677 1.054 --samples samples.jsonl -o sheet.pdf
    """
    from labkit.figures.plots import require_format

    test = _test(path, loading)
    require_format(sheet.output, ".pdf")
    if sheet.ags4 is not None:
        require_ags4(test)
    tests = calibration.tests(measured, scene)
    prediction = predict_test(tests, posterior_of(tests, read_samples(tests, samples)), test, **vars(specimens))
    table = prediction.table()
    print(f"{prediction.title}\n{table.to_string(index=False, float_format='%.4g')}")
    write_pdf(prediction, sheet.output, [*measured, samples])
    if sheet.ags4 is not None:
        write_ags4(prediction, sheet.ags4)
    write_table(table, sheet.csv, [*measured, samples])
