"""Descriptions and examples of the commands, for `labkit COMMAND --help`."""

from __future__ import annotations

DESCRIPTIONS = {
    "specimen": (
        "Makes a periodic specimen at a given void ratio: grains are inserted at random and come to rest in two steps. "
        "Writes a state file.",
        "labkit specimen --void-ratio 0.67 --grains 4000 --engine fused -o s.state.nc",
    ),
    "consolidate": (
        "Brings the three normal stresses of a specimen to a pressure. Writes the consolidated specimen as a state "
        "file. `labkit run` does this by itself if the path holds a stress.",
        "labkit consolidate s.state.nc --pressure 500kPa --engine fused",
    ),
    "run": (
        "Loads a specimen along a path. Writes a run file with stresses, strains and statistics at each record, and "
        "the contacts at some of them. Repeat the same command to resume an interrupted run.",
        "labkit run cv s.state.nc --strain 0.1 --engine fused -o r.run.nc\n"
        "labkit run cp s.state.nc --pressure 300kPa --strain 5% --engine fused\n"
        "labkit run cp --help                  # only the options of this path",
    ),
    "probe": (
        "Applies small increments of strain or stress in many directions, each to the same state. Writes a probes file "
        "with all increments, and prints the range of the stiffness and the symmetry of its fit. `labkit figure "
        "envelope` draws the file.",
        "labkit probe r.run.nc --elastic --model --engine fused -o e.probes.nc\n"
        "labkit probe s.state.nc --plane all --elastic --engine fused",
    ),
    "driver": (
        "Carries out a test of the Incremental Driver of A. Niemunis, on grains or on labkit's constitutive model. "
        "Writes a run file, and the driver's output file with time, strains, stresses and state variables.",
        "labkit driver test.inp --on s.state.nc --initial initialconditions.inp --engine fused\n"
        "labkit driver test.inp --on model --initial initialconditions.inp --parameters parameters.inp",
    ),
    "stratified": (
        "Makes the layer of Fig. 3, a stratum of coarse discs over one of fine discs, and loads it biaxially. Writes "
        "a state file and a figure, and prints a table of the strata.",
        "labkit stratified --size-ratio 2 --engine fused -o layer.state.nc",
    ),
    "verify": (
        "Compares the stress that C0 predicts with Love's stress, and checks the energy balance and what the path "
        "holds. Prints a table and the checks, which docs/verify.md explains, and writes a figure. Exit code 1 if a check "
        "fails.",
        "labkit verify r.run.nc --csv checks.csv",
    ),
    "critical": (
        "Averages the last quarter of each shear test, its critical state. Prints a table and writes a figure of the "
        "paths in e and p, and in q and p.",
        "labkit critical cv.run.nc cp.run.nc --csv critical.csv",
    ),
    "figure": (
        "Draws a figure of a run. Writes the figure, and prints the table behind it or writes it as CSV.",
        "labkit figure family r.run.nc\nlabkit figure records r.run.nc --variable void_ratio",
    ),
    "picture": (
        "Draws the grains (left) and the contact forces (right) in 3D. Writes an image, or a page for a browser "
        "with a 3D view and a slider over the snapshots.",
        "labkit picture r.run.nc --snapshot 0 -1\nlabkit picture r.run.nc -o r.html",
    ),
    "paraview": (
        "Writes grains, contacts and cell of each snapshot in a format that ParaView opens, with a .pvd file for the "
        "series.",
        "labkit paraview r.run.nc -o r_paraview",
    ),
    "watch": (
        "Plots runs in the terminal, again and again, while they are computed. Writes no file. Stop it with Ctrl-C.",
        "labkit watch *.run.nc",
    ),
    "import": (
        "Reads grains, and contacts if there are any, from a file of another program. What the file does not say (box, "
        "units, radii or diameters, sign of forces) is asked for. Checks the grains, and writes them as a state file "
        "at rest; normal forces follow from the overlaps and the contact law.",
        "labkit import pack.txt --length-unit m -o mine.state.nc\n"
        "labkit import grains.csv --contacts contacts.csv --box 4,4,4 --length-unit mm --size radius "
        "--force-unit N --force-sign compression -o mine.state.nc",
    ),
    "export": (
        "Writes the records of a run, or the contacts or grains of one snapshot or of a state file, as CSV with the "
        "unit of each column in the header; or grains and contacts in the format of another program, chosen by the "
        "ending of the file name.",
        "labkit export r.run.nc -o r.csv\nlabkit export r.run.nc --snapshot -1 --table grains\n"
        "labkit export s.state.nc -o s.data         # LAMMPS\nlabkit export s.state.nc -o s.vtkhdf       # ON-DEM\n"
        "labkit export s.state.nc -o load_s.py      # a script for YADE\nlabkit export r.run.nc -o r.zarr",
    ),
    "statistics": (
        "Computes Z, A, Lambda, F, F^t, Love's stress and C0 from the grains and contact forces in a file of labkit or "
        "of another program. Prints them. Options and checks are those of `labkit import`.",
        "labkit statistics grains.dump --contacts contacts.local --contact-columns id1,id2,-,fx,fy,fz,- --json s.json",
    ),
    "info": (
        "Prints the contents of a state, run or probes file, and how it was made: command, versions, computer, inputs.",
        "labkit info r.run.nc --check",
    ),
    "model": (
        "Integrates the constitutive model C0 to C5 along a loading path from an isotropic state, without grains. "
        "Writes a run file, which verify, figure and critical accept.",
        "labkit model cv --void-ratio 0.67 --pressure 500kPa --strain 0.2",
    ),
    "calibrate": (
        "Fits the parameters of the constitutive model to runs. Prints a report, and writes the parameters, a table "
        "and a figure if asked to.",
        "labkit calibrate cv.run.nc cp.run.nc isoc.run.nc isod.run.nc -o fitted.json --figure fit.png",
    ),
    "model-speed": (
        "Measures time and error of the integrators of the constitutive model. Prints a table, and writes it to "
        "model_speed.txt and a figure to model_speed.png.",
        "labkit model-speed -o measured",
    ),
    "campaign": (
        "Carries out the specimens and runs defined in one file with Snakemake, here or on a SLURM cluster. Writes a "
        "folder with all results and report.md. Repeat the same command to resume, or after a change of the file.",
        "labkit campaign quick --dry-run\n"
        "labkit campaign mine.yaml --cores 4\n"
        "labkit campaign mine.yaml --profile slurm\n"
        "labkit campaign mine.yaml --crate         # after it: ro-crate-metadata.json, for an archive",
    ),
    "bench": (
        "Measures the speed of a CV test: of a stock YADE script, labkit's engines and LAMMPS, where installed. "
        "Prints a table.",
        "labkit bench s.state.nc --steps 500\n"
        "labkit bench s.state.nc --what gpu --csv gpu.csv      # batches of specimens on a GPU",
    ),
    "bench-statistics": (
        "Measures the time and memory of each statistic of a run. Prints a table.",
        "labkit bench-statistics r.run.nc",
    ),
    "density": (
        "Makes the loosest and the densest specimen of the material by a stated protocol. Prints e_min, e_max and the "
        "relative density of the specimen.",
        "labkit density s.state.nc --engine fused",
    ),
    "grading": (
        "Compares the grading that was asked for with the sizes of the grains. Prints a table and writes a figure.",
        "labkit grading s.state.nc",
    ),
    "twins": (
        "Makes a specimen with the void ratio and the pressure of another one and a lower coordination number, by "
        "small cycles of shear. Writes a state file.",
        "labkit twins s.state.nc --engine fused",
    ),
    "umat": (
        "Writes the constitutive model as a material law for finite-element programs: Fortran and C sources, the table "
        "of PROPS, and with --build the shared library.",
        "labkit umat -o law --build",
    ),
    "umat-speed": (
        "Compiles the material law and measures its updates per second on one core, with and without the consistent "
        "tangent, beside those of the law in Python.",
        "labkit umat-speed -o umat_speed.txt",
    ),
    "demo": (
        "Makes a specimen of 4,000 grains, runs a CV test on the fused engine and compares C0 with Love's stress, in "
        "half a minute; then runs the same test in YADE, in a few minutes, and compares the engines. Writes a state "
        "file, two run files, a figure and a table.",
        "labkit demo -o demo",
    ),
}


def description_of(name: str, summary: str) -> str:
    """Description of a command; `summary`: used for a command that is not listed."""
    stop = "" if summary.endswith("?") else "."
    return DESCRIPTIONS[name][0] if name in DESCRIPTIONS else f"{summary[0].upper()}{summary[1:]}{stop}"


def examples_of(name: str) -> str:
    """Examples of a command, indented; empty if there are none."""
    if name not in DESCRIPTIONS:
        return ""
    lines = DESCRIPTIONS[name][1].splitlines()
    return "\n".join([f"example{'s' * (len(lines) > 1)}:", *(f"  {line}" for line in lines)])
