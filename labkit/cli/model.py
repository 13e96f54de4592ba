"""`labkit model`: the constitutive model from the command line."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Collection
from pathlib import Path as File
from typing import TYPE_CHECKING, Annotated, Literal

from labkit.cli import arguments
from labkit.cli.arguments import History, Option, ParameterTexts, PathOptions, Texts, one_of, require
from labkit.cli.outputs import model_name, tell_replaced
from labkit.cli.parser import name_list, summary_of
from labkit.cli.registry import command
from labkit.cli.simulate import named_path
from labkit.errors import InputError, PhysicsError
from labkit.files.netcdf import labkit_kind, open_netcdf
from labkit.files.writable import require_writable
from labkit.model.registry import MODELS
from labkit.parameters import check_parameters, parameter
from labkit.paths.registry import PATHS

if TYPE_CHECKING:
    import numpy as np

    from labkit.model.law import ConstitutiveLaw
    from labkit.model.state import ModelState

OEDOMETER = {"oedometer": "Axial compression without radial strain"}  # in axial and radial directions


@dataclasses.dataclass(frozen=True)
class InitialState:
    """Initial isotropic state of a test on the model, and accuracy of the integration."""

    void_ratio: float = parameter(None, above=0.0, help="initial void ratio, e.g. 0.67")
    pressure: float = parameter(
        None, unit="Pa", above=0.0, help="initial isotropic stress, which stress-controlled paths hold,"
    )
    coordination_number: float | None = parameter(
        None, above=0.0, help="initial coordination number Z (default: Z^com, the compression line at this void ratio)"
    )
    mean_normalised_force: float | None = parameter(
        None, above=0.0, help="initial mean normalised contact force Lambda (default: from the pressure and Z)"
    )
    inherent_anisotropy: float = parameter(
        0.0, above=-1.0, high=2.0, help="initial contact anisotropy a1, under an isotropic stress"
    )
    angle: float = parameter(
        0.0, low=-360.0, high=360.0, help="angle between the axis of the initial anisotropy and z, degrees"
    )
    stop_pressure: float | None = parameter(
        None, unit="Pa", above=0.0, help="final mean stress of isoc and isod (default: 3e6 for isoc, 20e3 for isod)"
    )
    record_strain: float | None = parameter(
        None, above=0.0, high=1.0, help="axial strain between two records (default: the path's)"
    )
    stop_when: str | None = parameter(None, kind=str, help="condition that ends the test at a record, e.g. 'q/p > 0.9'")
    tolerance: float = parameter(1e-6, above=0.0, high=1.0, help="relative error allowed in one integration step")

    def __post_init__(self) -> None:
        """Check every parameter. Raises InputError."""
        check_parameters(self)


Beyond = Literal["error", "flat"]
BeyondECmax = Annotated[
    Beyond,
    Option("for void ratios above e_cmax: stop with an error (default), or use flat lines, Z^c = 4 and Lambda^c = 0"),
]
ModelParameters = Annotated[
    str | None, Option("parameters of the model, from labkit calibrate -o (default: Table 2)", "FILE")
]


def list_of_tests(words: Collection[str]) -> str:
    """List the loading paths, for the end of the help."""
    texts = {kind.name: summary_of(kind) for kind in arguments.paths_to_explain(words)}
    return name_list("loading path", texts | OEDOMETER if len(texts) > 1 else texts)


@command("model", epilog=list_of_tests)
def model_command(
    path: Annotated[str | None, Option(f"loading path, one of {', '.join(PATHS)}, or a path file, FILE.yaml")] = None,
    *,
    start: Annotated[Texts, ParameterTexts(InitialState, "initial state and integration")],
    loading: Annotated[Texts, PathOptions(leave_out=("pressure",))],
    model: Annotated[
        str, Option(f"constitutive law, one of {', '.join(MODELS)}", "NAME", type=one_of(MODELS))
    ] = "labkit",
    beyond_e_cmax: BeyondECmax = "error",
    parameters: ModelParameters = None,
    output: Annotated[
        str | None, Option("run file to write (default: a name built from the parameters)", "FILE")
    ] = None,
    history: History,
) -> None:
    """Integrates a constitutive law along a loading path from an isotropic state, without grains.

    The law is labkit's model C0 to C5, or with --model another one (docs/peers.md).

    Writes a run file, which verify, figure and critical accept. If the integration fails, it contains the records up
    to that point.

    Example:
        labkit model cv --void-ratio 0.67 --pressure 500kPa --strain 0.2
    """
    from labkit.grains.scene import Scene
    from labkit.model.controls import model_path, stops_at_pressure
    from labkit.model.driver import drive
    from labkit.model.integrators import Adaptive
    from labkit.model.parameters import Model
    from labkit.model.run_file import as_run, read_law, records_of_result, write_result
    from labkit.records.limits import exceeded_limits

    word = require(path, "path", f"one of {', '.join(PATHS)}, or a path file")
    kind, written = named_path(word)
    file_pressure = written.pop("pressure", None)
    if file_pressure is not None:
        field = "stop_pressure" if stops_at_pressure(kind) else "pressure"
        start = {field: file_pressure, **start}
    for field, example in (("void_ratio", "one, e.g. 0.67"), ("pressure", "one, e.g. 500kPa")):
        require(start.get(field), field, example)
    at = InitialState(**start)
    law = read_law(model, parameters)
    law = law.reading(beyond_e_cmax=beyond_e_cmax) if isinstance(law, Model) else law
    test = model_path(kind.name, at.pressure, at.stop_pressure, **{**written, **loading})
    state = first_state(law, at)
    given = {**start, **loading}
    output = output or model_name(File(word).stem, kind, InitialState, given, model, parameters, beyond_e_cmax)
    require_output(output)
    tell_replaced(output)
    begin = time.perf_counter()
    result = drive(law, test, state, at.record_strain, Adaptive(at.tolerance), at.stop_when)
    settings = {"tolerance": at.tolerance, **({} if at.stop_when is None else {"stop_when": at.stop_when})}
    write_result(output, result, history, time.perf_counter() - begin, settings)
    if result.failure:
        raise PhysicsError(
            f"{result.failure}; the {len(result)} records up to that point are in {output} (complete = 0)"
        )
    for text in filter(None, (result.endings.reason, *result.endings.words(at.stop_when))):
        print(f"{output}: {text}")
    for limit in exceeded_limits(records_of_result(result), Scene(young_modulus=law.young_modulus)):
        print(f"{output}: {limit}")
    strain = as_run(result).lab.strain()
    statistics = f"Z {result.Z[-1]:.3f}, Lambda {result.Lam[-1]:.5f}, " if isinstance(law, Model) else ""
    e, p = result.e[-1], result.p[-1]
    print(
        f"{output}: {test.name} complete, {len(result)} records, "
        f"{strain.attrs['long_name']} {float(strain[-1]):.2%}, "
        f"e {e:.4f}, {statistics}p {p / 1e6:.4f} MPa, q/p {result.q[-1] / p:.3f}"
    )


def first_state(law: ConstitutiveLaw, at: InitialState) -> ModelState | np.ndarray:
    """Return the isotropic state at which a test begins. Raises InputError for an option that the law does not use."""
    import numpy as np

    from labkit.model.law import RateLaw
    from labkit.model.parameters import Model
    from labkit.model.state import isotropic_state, with_inherent_anisotropy

    if isinstance(law, Model):
        state = isotropic_state(law, at.void_ratio, at.pressure, at.coordination_number, at.mean_normalised_force)
        return with_inherent_anisotropy(law, state, at.inherent_anisotropy, math.radians(at.angle))
    for field in ("coordination_number", "mean_normalised_force", "inherent_anisotropy"):
        if getattr(at, field):
            raise InputError(f"is not a variable of {law.name}: leave it out", field=field)
    assert isinstance(law, RateLaw)
    return law.start(at.void_ratio, at.pressure * np.eye(3))


def require_output(file: str) -> None:
    """Raise InputError if the file cannot be written, or if it contains a simulation, which is never overwritten."""
    require_writable(file, "run")
    if File(file).exists() and labkit_kind(file) == "run":
        with open_netcdf(file, "run") as dataset:
            if getattr(dataset, "engine", None) != "model":
                raise InputError(f"{file} holds a simulation, which would be overwritten: choose another name")
