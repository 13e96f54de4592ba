"""The options of the model's commands; it loads neither scipy nor numba, so that other commands start fast."""

from __future__ import annotations

from labkit.cli.arguments import strains
from labkit.model.parameters import READINGS
from labkit.dem.paths import PATHS


def add_model_options(parser):
    parser.add_argument("path", nargs="?", help=f"loading path: {', '.join((*PATHS, 'oedometer'))}")
    parser.add_argument("--void-ratio", type=float, help="at the start, e.g. 0.67")
    parser.add_argument("--pressure", type=float, help="isotropic stress at the start in Pa, e.g. 0.5e6; cr, cp and "
                        "cyclic_cp hold it")  # fmt: skip
    parser.add_argument("--coordination-number", type=float, help="Z at the start (default: the compression line "
                        "Z^com of the void ratio)")  # fmt: skip
    parser.add_argument("--mean-normalised-force", type=float, help="Lambda at the start (default: from the "
                        "pressure and Z)")  # fmt: skip
    parser.add_argument("--inherent-anisotropy", type=float, default=0.0, help="a1 of the contacts at the start, "
                        "under an isotropic stress (default: 0)")  # fmt: skip
    parser.add_argument("--angle", type=float, default=0.0, help="of its axis from z in degrees (default: 0)")
    parser.add_argument("--strain", type=float, help="axial strain to reach (default: 0.4; isoc, oedometer 0.1, "
                        "isod -0.1)")  # fmt: skip
    parser.add_argument("--rate", type=float, help="axial strain rate in 1/s: the scale of `time` alone")
    parser.add_argument("--reversals", type=strains, help="axial strains at which cyclic_cp turns")
    parser.add_argument("--stop-pressure", type=float, help="mean stress in Pa where isoc (3e6), isod (20e3) stop")
    parser.add_argument("--record-strain", type=float, help="strain between records (default: 1e-3; isoc, isod 1e-4)")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="error of an integration step (default: 1e-6)")
    parser.add_argument("--beyond-e-cmax", choices=READINGS["beyond_e_cmax"], default="error", help="what holds for "
                        "void ratios above e_cmax: error (default), or flat: Z^c = 4, Lambda^c = 0")  # fmt: skip
    parser.add_argument("--parameters", help="JSON file of labkit calibrate (default: Table 2)")
    parser.add_argument("-o", "--output", help="run file to write")


def add_calibrate_options(parser):
    parser.add_argument("run", nargs="+", help="run files: shear tests, better isoc and isod too")
    parser.add_argument("-o", "--output", help="JSON file for the fitted parameters, for labkit model --parameters")
    parser.add_argument("--csv", help="file for the table as CSV")
    parser.add_argument("--figure", help="figure of the runs and of the fitted model")
