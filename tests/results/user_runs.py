"""The runs that users make, and everything that they then ask of a run: the rows and columns of test_user_matrix."""

import contextlib
import io
import warnings
from pathlib import Path

import matplotlib.pyplot as plt

import labkit as lk
from labkit.cli import main
from labkit.paths.cycles import UndrainedCycles
from labkit.paths.element_tests import SimpleShearConstantVolume
from labkit.quantities import QUANTITIES
from labkit.results.figures import FIGURES
from labkit.results.info import describe_file
from tests.plugins.laboratory_data.columns import of_columns
from tests.stopped import run_stopped

MIXED = """\
path: steps
pressure: 200 kPa
steps:
  - {strain: {zz: 0.4 %}, stress: {xx: 0, yy: 0}, until: q/p > 0.1, records: 8}
  - {strain: {zz: 0.4 %, xx: -0.2 %, yy: -0.2 %}, records: 4}
"""
MEASURED = """\
ea,q,s3,u
0,0,100,0
0.01,80,100,30
0.02,100,100,50
0.03,110,100,60
"""
P = "200 kPa"
RUNS = (
    *("compression", "extension", "shear", "mixed", "undrained", "continued", "cycles", "stopped", "no_snapshots"),
    *("unfinished", "clumps", "model", "measured"),
)


def measured_test(folder):
    """A consolidated undrained triaxial test from a laboratory."""
    file = folder / "u.csv"
    file.write_text(MEASURED)
    columns = of_columns(e1="ea:1", q="q:kPa", s3="s3:kPa", u="u:kPa")
    meaning = {"strain_kind": "engineering", "stress_kind": "total", "source": "x", "licence": "y"}
    return lk.read_measured(file, lk.paths.ConstantVolume(strain=0.1), columns, void_ratio=0.7, **meaning)


def make_runs(folder):
    """Write the run files of the matrix, name -> file; about 200 grains, few records."""
    folder = Path(folder)
    options = {"progress": False, "snapshots": 2}
    state = lk.consolidate(lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=200), progress=False), P, progress=False)
    files = {}

    def run(name, path, start=state, **more):
        files[name] = folder / f"{name}.run.nc"
        return lk.run(start, path, file=files[name], **{**options, "record_strain": 1e-3, **more})

    run("compression", lk.paths.ConstantRadialStress(pressure=P, strain=0.01))
    run("extension", lk.paths.ConstantRadialStress(pressure=P, strain=-0.01))
    run("shear", SimpleShearConstantVolume(strain=0.01))
    (folder / "mixed.yaml").write_text(MIXED)
    run("mixed", lk.read_path(folder / "mixed.yaml"), record_strain=None)
    first = run("undrained", lk.paths.ConstantVolume(strain=0.004))
    run("continued", lk.paths.ConstantVolume(strain=0.004), first.state)
    run("cycles", UndrainedCycles(ratio=0.1, cycles=1), record_strain=5e-4)
    run("stopped", lk.paths.ConstantMeanStress(pressure=P, strain=0.01), stop_when="abs(axial_strain) > 0.5 %")
    run("no_snapshots", lk.paths.ConstantMeanStress(pressure=P, strain=0.004), snapshots=0)

    files["unfinished"], path = folder / "unfinished.run.nc", lk.paths.ConstantMeanStress(pressure=P, strain=0.01)
    run_stopped(0.5, state, path, file=files["unfinished"], **options, record_strain=1e-3, save_every=1)
    clumps = lk.make_specimen(lk.Recipe(void_ratio=0.6, grains=100, shape="rod aspect_ratio=1.5"), progress=False)
    run("clumps", lk.paths.ConstantVolume(strain=0.004), clumps)
    files["model"] = folder / "model.run.nc"
    command("model", "cr", "--pressure", P, "--void-ratio", "0.67", "--strain", "0.02", "-o", files["model"])
    files["measured"] = folder / "measured.run.nc"
    lk.write_measured(measured_test(folder), files["measured"])
    assert set(files) == set(RUNS)
    return files


def command(*words):
    """Call a command in this process and return what it prints; raise what it refuses as InputError."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
        code = main(list(map(str, words)))
    if code == 2:
        raise lk.InputError(printed.getvalue().strip())
    assert code in (0, 1), printed.getvalue()
    return printed.getvalue()


ARGUMENTS = {  # of methods of the accessor that have no defaults
    **dict.fromkeys(("snapshot", "contacts", "contacts_table"), (-1,)),
    "component": ("contact_anisotropy",),
    "at_snapshots": ("void_ratio",),
    "step": (1,),
    **dict.fromkeys(("quantity", "variable"), ("q/p",)),
    "over_snapshots": (lambda snapshot: {"n": float(len(snapshot.contacts))},),
    "part_of_q": None,  # takes tensors
}


def columns(run):
    """Everything asked of a run: name -> function of (file, folder)."""
    asked = {
        "repr": lambda file, folder: repr(run),
        "display": lambda file, folder: run._repr_html_(),
        "dataset": lambda file, folder: repr(run.data),
        "met": lambda file, folder: (run.complete, run.met_conditions, run.ended_because),
        "exceeded": lambda file, folder: run.exceeded,
        "state": lambda file, folder: run.state,
        "summary": lambda file, folder: lk.open_runs([file]).runs.summary().to_dataframe(),
        "open_runs": lambda file, folder: lk.open_runs([file]).lab.q(),
        "interpolate": lambda file, folder: lk.open_runs([file]).runs.interpolate([1e-3], "accumulated_strain"),
        "info": lambda file, folder: describe_file(file),
        "verify": lambda file, folder: lk.verify(file),
        "critical": lambda file, folder: lk.critical_states({"run": run}),
        "export": lambda file, folder: command("export", file, "-o", folder / f"{file.name}.csv"),
        "export snapshot": lambda file, folder: command("export", file, "--snapshot", -1, "-o", folder / "s.csv"),
        "figure planes as a command": lambda file, folder: command("figure", "planes", file, "-o", folder / "f.png"),
    }
    for name in [*FIGURES]:
        if FIGURES[name].needs != "probes":
            asked[f"figure {name}"] = lambda file, folder, name=name: drawn(run, name)
    for name in ("q", "q/p", "r_u", "friction_angle", "axial_strain", "time", "deviatoric_strain", "cycles", "A"):
        asked[f"figure records {name}"] = lambda file, folder, name=name: drawn(run, "records", variable=name)
    return asked


def members(run):
    """The public members of `run.lab`: name -> function of (file, folder) that calls it with ordinary arguments."""

    def member(name):
        value = getattr(run.data.lab, name)
        value = value(*ARGUMENTS.get(name, ())) if callable(value) else value
        return list(value) if name == "snapshots" else value

    names = [name for name in dir(type(run.data.lab)) if not name.startswith("_")]
    wanted = [name for name in names if ARGUMENTS.get(name, ()) is not None]
    asked = {f"lab.{name}": lambda file, folder, name=name: member(name) for name in wanted}
    rows = {f"quantity {name}": lambda file, folder, name=name: run.data.lab.quantity(name) for name in QUANTITIES}
    return asked | rows


def drawn(run, name, **options):
    """A figure of a run, rendered."""
    figure = run.plot(name, **({"variable": "void_ratio"} if name == "records" else {}) | options)
    figure.canvas.draw()
    plt.close("all")
    return figure


def cell(ask):
    """What a user gets: "value", or the sentence of a refusal. Raises anything else, warnings of NumPy included."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", RuntimeWarning)
        try:
            ask()
        except lk.InputError as refused:
            sentence = str(refused)
            assert sentence and "\n" not in sentence, sentence
            return sentence
    return "value"
