"""The command line: `labkit specimen`, `consolidate`, `run`, `verify`, `critical`, `figure`, `picture`, `paraview`,
`watch`, `info`, `bench`, `demo`; `speed-error`, `hard-cases`, `campaign`, `paper`, `notebooks`, `report`; `model`,
`calibrate`, `model-figures`, `model-speed`.
"""

from __future__ import annotations

import json
import os
import shlex
import sys
from pathlib import Path

import labkit
from labkit.cli import arguments
from labkit.cli import commands
from labkit.campaign.command import add_campaign_options as campaign_options
from labkit.engines import ENGINES
from labkit.engines.yade_process import find_yade, run_script
from labkit.errors import InputError, Interrupted, PhysicsError, fail
from labkit.io.files import labkit_kind, make_folder, require_writable
from labkit.hard_scenes import GRAINS, SCENES
from labkit.io.memory import return_large_arrays
from labkit.model import options as model_options
from labkit.io.progress import reporter
from labkit.io.provenance import write_told

FIGURES = ("groups", "densities", "directions", "shares", "family", "budget", "contacts")  # of labkit.visuals.micro_figures


def main(argv=None):
    """Runs a command; returns 0 done, 1 the physics or a check failed, 2 bad input."""
    argv = sys.argv[1:] if argv is None else argv
    return_large_arrays()
    try:
        return call(argv)
    except InputError as error:
        return fail(error, 2)
    except PhysicsError as error:
        return fail(error, 1)
    except Interrupted as error:
        return fail(error, error.code)
    except BrokenPipeError:  # whoever read the output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return fail(f"{error.filename or 'a file'}: {error.strerror or error}", 1)
    except KeyboardInterrupt:
        return fail("interrupted", 130)


def call(argv):
    """Runs a command and returns its exit code. Raises InputError, PhysicsError or Interrupted where it gives up."""
    options = arguments.parse(build_parser(), argv)
    return options.command(options, argv) or 0


def build_parser():
    parser = arguments.Parser(prog="labkit", description="A virtual laboratory for granular soil.")
    parser.add_argument("--version", action="version", version=f"labkit {labkit.__version__}")
    commands_ = parser.add_subparsers(metavar="COMMAND", required=True)

    specimen = commands_.add_parser("specimen", help="make a specimen: a state file")
    arguments.add_specimen_options(specimen)
    specimen.set_defaults(command=do_specimen)

    run = commands_.add_parser("run", help="take a specimen along a loading path: a run file")
    arguments.add_run_options(run)
    run.set_defaults(command=do_run)

    consolidate = commands_.add_parser("consolidate", help="bring a specimen to a pressure: a state file")
    arguments.add_consolidation_options(consolidate)
    consolidate.set_defaults(command=do_consolidate)

    verify = commands_.add_parser("verify", help="SFF against Love: a table and a figure")
    verify.add_argument("run", nargs="+", help="run files")
    verify.add_argument("-o", "--output", help="figure (default: beside the first run file)")
    verify.add_argument("--rows", type=arguments.positive_int, default=20, help="rows of the table (default: 20)")
    verify.add_argument("--csv", help="file for the checks and limits as CSV")
    verify.set_defaults(command=do_verify)

    critical = commands_.add_parser("critical", help="critical state of shear tests: a table, and their e-p paths")
    critical.add_argument("run", nargs="+", help="run files")
    critical.add_argument("-o", "--output", default="critical.png", help="figure (default: critical.png)")
    critical.add_argument("--csv", help="file for the table as CSV")
    critical.set_defaults(command=do_critical)

    model = commands_.add_parser("model", help="C0 to C5 along a loading path, no grains: a run file")
    model_options.add_model_options(model)
    model.set_defaults(command=do_model)

    calibrate = commands_.add_parser("calibrate", help="parameters of the model from run files")
    model_options.add_calibrate_options(calibrate)
    calibrate.set_defaults(command=do_calibrate)

    for name, words, command in (
        ("model-figures", "Figs. 4 to 10 of the model alone, from Table 2", do_model_figures),
        ("model-speed", "speed against error of the model's integrators: a table and a figure", do_model_speed),
    ):
        results = commands_.add_parser(name, help=words)
        results.add_argument("-o", "--output", default="results", help="folder that is there (default: results)")
        results.set_defaults(command=command)

    figure = commands_.add_parser("figure", help="grains, contacts and forces of a run: a figure and its table")
    figure.add_argument("figure", metavar="FIGURE", choices=FIGURES, help=", ".join(FIGURES))
    figure.add_argument("run", help="run file")
    figure.add_argument("--groups", type=arguments.positive_int, default=5, help="size groups (default: 5)")
    figure.add_argument("--snapshot", type=int, default=-1, help="which one, from the end if negative (default: -1)")
    figure.add_argument("-o", "--output", help="figure (default: beside the run file)")
    figure.add_argument("--csv", help="file for the table as CSV")
    figure.set_defaults(command=do_figure)

    picture = commands_.add_parser("picture", help="grains and contact forces in three dimensions: a picture")
    picture.add_argument("file", help="state or run file")
    picture.add_argument("--snapshot", type=int, nargs="+", help="of a run: which ones, one below the other, from the "
                         "end if negative (default: -1)")  # fmt: skip
    picture.add_argument("-o", "--output", help="picture (default: beside the file)")
    picture.set_defaults(command=do_picture)

    paraview = commands_.add_parser("paraview", help="grains, contacts and cell as files that ParaView opens")
    paraview.add_argument("file", help="state or run file")
    paraview.add_argument("--snapshot", type=int, nargs="+", help="of a run: which ones, from the end if negative "
                          "(default: all)")  # fmt: skip
    paraview.add_argument("-o", "--output", help="folder (default: beside the file)")
    paraview.set_defaults(command=do_paraview)

    stratified = commands_.add_parser("stratified", help="Fig. 3: coarse grains above fine ones, forces and strata")
    arguments.add_layer_options(stratified)
    stratified.add_argument("--figure", help="figure (default: beside the state file)")
    stratified.add_argument("--csv", help="file for the table as CSV")
    stratified.set_defaults(command=do_stratified)

    watch = commands_.add_parser("watch", help="draw runs in the terminal while they go on")
    watch.add_argument("run", nargs="+", help="run files")
    watch.add_argument("--interval", type=arguments.positive_int, default=5, help="seconds between two drawings")
    watch.add_argument("--once", action="store_true", help="draw once")
    watch.set_defaults(command=do_watch)

    info = commands_.add_parser("info", help="what is in a state or run file")
    info.add_argument("file")
    info.add_argument("--check", action="store_true", help="recompute the hashes of its data and of its inputs")
    info.set_defaults(command=do_info)

    bench = commands_.add_parser("bench", help="speed on one scene: a stock YADE script, labkit's engines, LAMMPS")
    bench.add_argument("specimen", help="state file")
    bench.add_argument("--what", choices=("engines", "features", "sizes"), default="engines", help="compare engines "
                       "(default), what each feature of the engine fused costs, or sizes of specimens")  # fmt: skip
    bench.add_argument("--steps", type=arguments.positive_int, default=500, help="steps of one measurement")
    bench.add_argument("--rounds", type=arguments.positive_int, default=5, help="measurements of each, in turn")
    bench.set_defaults(command=do_bench)

    study = commands_.add_parser("speed-error", help="speed against error of all settings: data, figures and a page")
    study.add_argument("--design", choices=("full", "small"), default="full", help="full: hours; small: the same in a "
                       "minute (default: full)")  # fmt: skip
    study.add_argument("--work", help="folder of specimens and runs, from which an interrupted study goes on "
                       "(default: speed_error_full or speed_error_small)")  # fmt: skip
    study.add_argument("--from", dest="earlier", help="study.nc of a study whose tests need not be repeated")
    study.add_argument("--jobs", type=arguments.positive_int, help="runs at a time (default: as many as cores)")
    study.add_argument("-o", "--output", default="results/speed_error", help="folder of the results (default: "
                       "results/speed_error)")  # fmt: skip
    study.set_defaults(command=do_speed_error)

    statistics = commands_.add_parser("bench-statistics", help="speed and memory of the statistics of a run")
    statistics.add_argument("run", help="run file")
    statistics.set_defaults(command=do_bench_statistics)

    hard = commands_.add_parser("hard-cases", help="scenes at which a simulation may go wrong: run, judged, a page")
    hard.add_argument("name", nargs="*", help=f"which ones: {', '.join(SCENES)} (default: all)")
    hard.add_argument("--engine", choices=(*ENGINES, "both"), default="both", help="(default: both)")
    hard.add_argument("--grains", type=arguments.positive_int, default=GRAINS, help="of a specimen (default: "
                      f"{GRAINS})")  # fmt: skip
    hard.add_argument("-o", "--output", default="results/hard_cases", help="folder of the page, the table and the "
                      "figure (default: results/hard_cases)")  # fmt: skip
    hard.add_argument("--work", default="hard_cases", help="folder of the run files; finished cases there are not run "
                      "again (default: hard_cases)")  # fmt: skip
    hard.set_defaults(command=do_hard_cases)

    campaign = commands_.add_parser("campaign", help="many specimens and runs from one file, here or on a cluster")
    campaign_options(campaign)
    campaign.set_defaults(command=do_campaign)

    paper = commands_.add_parser("paper", help="the paper's tests: runs the campaign, makes tables, figures, a report")
    paper.add_argument("campaign", nargs="?", help="folder of the campaign: it is begun there, or goes on (default: "
                       "none, everything is made of the thin run files in the output)")  # fmt: skip
    paper.add_argument("--as-is", action="store_true", help="run nothing, take what is finished in the folder")
    paper.add_argument("--cores", type=arguments.positive_int, default=os.cpu_count() or 1, help="of this machine "
                       "(default: all)")  # fmt: skip
    paper.add_argument("-o", "--output", default="results/paper", help="folder of the results (default: "
                       "results/paper)")  # fmt: skip
    paper.set_defaults(command=do_paper)

    notebooks = commands_.add_parser("notebooks", help="redraw the paper's figures with the notebooks of analysis/")
    notebooks.add_argument("folder", nargs="?", default="analysis", help="folder of notebooks (default: analysis)")
    notebooks.add_argument("--results", default="results/paper", help="folder of the data (default: results/paper)")
    notebooks.add_argument("-o", "--output", help="folder of the figures (default: that of the data)")
    notebooks.set_defaults(command=do_notebooks)

    report = commands_.add_parser("report", help="one page of the paper's tests: figures, tables, provenance")
    report.add_argument("folder", nargs="?", default="results/paper", help="of labkit paper (default: results/paper)")
    report.add_argument("-o", "--output", help="HTML file (default: report.html in the folder)")
    report.set_defaults(command=do_report)

    demo = commands_.add_parser("demo", help="specimen, CV test and verification in a few minutes")
    demo.add_argument("-o", "--output", default="demo", help="folder for the results (default: demo)")
    demo.set_defaults(command=do_demo)
    return parser


def do_specimen(options, argv):
    commands.check_specimen(options)
    on_engine(options, argv, "specimen", "specimen.py", commands.specimen)


def do_run(options, argv):
    commands.check_run(options)
    on_engine(options, argv, options.path, "path.py", commands.run_path)


def do_consolidate(options, argv):
    commands.check_consolidation(options)
    on_engine(options, argv, "consolidation", "consolidate.py", commands.consolidation)


def on_engine(options, argv, title, script, command):
    """Runs the command where its engine lives: here, or as a script of yade_scripts in a YADE of its own."""
    if options.engine == "yade":
        find_yade()
        run_script(script, argv[1:], options.threads, reporter(title))
    else:
        command(options, reporter(title), history_of(argv))


def do_verify(options, argv):
    from labkit.visuals import plots
    from labkit.runs import verify

    runs = open_runs(options.run)
    verify.require_contacts(runs)
    figure = options.output or figure_name(options.run[0], "verify")
    require_outputs(figure, options.csv)
    found = {name: verify.findings(run) for name, run in runs.items()}
    for name, run in runs.items():
        print(f"{name}: path {run.attrs['path']}, {run.sizes['grain']} grains, {run.sizes['time']} records"
              + ("" if run.attrs["complete"] else ", not complete yet"))  # fmt: skip
        print(verify.table(run, options.rows))
        print(*found[name], sep="\n")
    plots.save(plots.sff_against_love(runs), figure, options.run)
    print(f"figure: {figure}")
    if options.csv:
        write_told(options.csv, verify.findings_csv(found), options.run)
    return 0 if all(f.holds for lines in found.values() for f in lines if f.decides) else 1


def do_critical(options, argv):
    from labkit.visuals import plots
    from labkit.runs.critical import SHEAR, critical_states

    runs = open_runs(options.run)
    require_outputs(options.output, options.csv)
    runs = {name: run for name, run in runs.items() if run.attrs["path"] in SHEAR}
    if not runs:
        raise InputError(f"there is no shear test among these runs: give runs of {', '.join(SHEAR)}")
    table = critical_states(runs)
    print(table.to_string(index=False, float_format="%.4g"))
    scatter = f" +- {table['M'].std():.3f} between tests" if len(table) > 1 else ""
    print(f"M of all: {table['M'].mean():.3f}{scatter} (paper: 0.92)")
    plots.save(plots.e_p_paths(runs), options.output, options.run)
    print(f"figure: {options.output}")
    if options.csv:
        write_told(options.csv, table.to_csv(index=False, float_format="%.5g"), options.run)


def do_model(options, argv):
    from labkit.model.commands import model_command

    model_command(options, history_of(argv))


def do_calibrate(options, argv):
    from labkit.model.commands import calibrate_command

    calibrate_command(options, open_runs(options.run))


def do_model_figures(options, argv):
    from labkit.model.figures import draw_all

    for file in draw_all(results_folder(options.output)):
        print(f"figure: {file}")


def do_model_speed(options, argv):
    from labkit.bench.model import measure_all

    print(measure_all(results_folder(options.output)))


def results_folder(folder):
    """The folder as a Path. Raises InputError unless files can be written there."""
    require_writable(Path(folder) / "labkit")
    return Path(folder)


def history_of(argv):
    return shlex.join(["labkit", *argv])


def do_figure(options, argv):
    from labkit.visuals import micro_figures
    from labkit.visuals import plots
    from labkit.runs.dataset import require_snapshots

    run = labkit.open_run(options.run)
    output = options.output or figure_name(options.run, options.figure)
    require_outputs(output, options.csv)
    if options.figure != "shares":
        require_snapshots(run, options.run, [options.snapshot], ", or draw its shares")
    figure, table = getattr(micro_figures, options.figure)(run, options.groups, options.snapshot)
    plots.save(figure, output, [options.run])
    print(f"figure: {output}")
    if options.csv:
        write_told(options.csv, table.to_csv(index=False, float_format="%.5g"), [options.run])
    else:
        print(table.to_string(index=False, float_format="%.4g", max_rows=30))


def do_picture(options, argv):
    from labkit.visuals import plots
    from labkit.runs.dataset import snapshots
    from labkit.visuals.picture import picture

    output = options.output or figure_name(options.file, "picture")
    require_outputs(output, None)
    numbers = options.snapshot or [-1] * (labkit_kind(options.file) == "run")
    plots.save(picture(snapshots(options.file, numbers)), output, [options.file])
    print(f"picture: {output}")


def do_paraview(options, argv):
    from labkit.visuals import paraview
    from labkit.runs.dataset import snapshots

    paraview.require_meshio()
    found = snapshots(options.file, options.snapshot or ())
    folder = make_folder(options.output or str(Path(figure_name(options.file, "paraview")).with_suffix("")), "-o")
    print(*paraview.write_series(found, folder), paraview.HINT, sep="\n")


def do_stratified(options, argv):
    import dataclasses

    import pandas

    from labkit.visuals import micro_figures
    from labkit.visuals import plots
    from labkit.dem import stratified
    from labkit.dem.state import read_state

    layer = commands.check_layer(options)
    figure = options.figure or options.output.removesuffix(".state.nc") + ".png"
    require_outputs(figure, options.csv)
    made = json.dumps(dataclasses.asdict(layer))
    if not (Path(options.output).exists() and read_state(options.output).recipe == made):
        shown = {"figure", "csv", "command"}
        words = [f"--{name.replace('_', '-')}={value}" for name, value in vars(options).items() if name not in shown]
        on_engine(options, ["stratified", *words], "layer", "stratified.py", commands.stratified)
    state = read_state(options.output)
    table = pandas.DataFrame([dataclasses.asdict(stratum) for stratum in stratified.strata(state)])
    plots.save(micro_figures.stratified_layer(state), figure, [options.output])
    print(table.T.to_string(header=False))
    print(f"figure: {figure}")
    if options.csv:
        write_told(options.csv, table.to_csv(index=False, float_format="%.5g"), [options.output])


def open_runs(files):
    """Name -> run, in the order of the command line; the name is as short as tells the files apart."""
    short = [Path(file).name.removesuffix(".run.nc") for file in files]
    names = short if len(set(short)) == len(short) else files
    return {name: labkit.open_run(file) for name, file in zip(names, files)}


def require_outputs(figure, csv):
    """Raises InputError unless the figure and the CSV file, if one is wanted, can be written."""
    from labkit.visuals.plots import FORMATS

    if Path(figure).suffix.lower() not in FORMATS:
        raise InputError(f"{figure} has no ending of a figure: use one of {', '.join(FORMATS)}")
    require_writable(figure)
    if csv:
        require_writable(csv)
        if Path(csv).resolve() == Path(figure).resolve():
            raise InputError(f"{csv} is named for the figure and for the CSV: give two names")


def do_watch(options, argv):
    from labkit.visuals.watch import watch

    watch(options.run, options.interval, options.once)


def figure_name(run, what):
    name = Path(run).name.removesuffix(".run.nc").removesuffix(".state.nc")
    return str(Path(run).with_name(f"{name}.{what}.png"))


def do_info(options, argv):
    from labkit.runs.info import check_file, describe_file

    print(describe_file(options.file))
    if options.check:
        lines, same = check_file(options.file)
        print("hashes", *lines, sep="\n")
        return 0 if same else 1


def do_bench(options, argv):
    from labkit.dem.state import read_state

    state = read_state(options.specimen)
    progress = reporter("bench")
    if options.what == "engines":
        from labkit.bench.engines import bench, table
        from labkit.dem.paths import ConstantVolume

        found = bench(options.specimen, options.steps, options.rounds, progress)
        print(table(found, state.number_of_grains, state.time_step, ConstantVolume().rate))
    else:
        from labkit.bench import kernel as bench_kernel

        if options.what == "features":
            print(bench_kernel.features(state, options.steps, options.rounds, progress))
        else:
            print(bench_kernel.sizes(state, options.steps, progress))


def do_speed_error(options, argv):
    from labkit.study.command import speed_error

    find_yade()
    work = options.work or f"speed_error_{options.design}"
    jobs = options.jobs or os.cpu_count() or 1
    progress = reporter("speed-error")
    for file in speed_error(options.design, work, options.output, jobs, progress, options.earlier):
        print(file)


def do_paper(options, argv):
    from labkit.paper.command import paper, simulate

    code = 0
    if options.campaign and not options.as_is:
        find_yade()
        code = simulate(options.campaign, options.cores, reporter("campaign"))
    for file in paper(options.campaign, options.output, history_of(argv), reporter("paper")):
        print(file)
    return int(code != 0)


def do_bench_statistics(options, argv):
    from labkit.bench.statistics import bench_statistics

    print(bench_statistics(options.run).to_string(index=False, float_format="%.2f", na_rep=""))


def do_hard_cases(options, argv):
    from labkit.hard_report import study

    engines = ENGINES if options.engine == "both" else (options.engine,)
    if "yade" in engines:
        find_yade()
    return study(
        options.name or list(SCENES), engines, options.grains, Path(options.output), Path(options.work), call,
        reporter("hard cases"), history_of(argv),
    )  # fmt: skip


def do_campaign(options, argv):
    from labkit.campaign.command import campaign

    return campaign(options)


def do_notebooks(options, argv):
    from labkit.paper.notebooks import execute, notebook_files

    for file in notebook_files(options.folder):
        execute(file, options.results, options.output or options.results)
        print(f"{file}: done", flush=True)


def do_report(options, argv):
    from labkit.paper.report import report

    output = options.output or str(Path(options.folder) / "report.html")
    report(options.folder, output, history_of(argv))
    print(f"page: {output}")


def do_demo(options, argv):
    from labkit.cli.demo import demo

    find_yade()
    return demo(Path(options.output), lambda words: main(shlex.split(words)))

