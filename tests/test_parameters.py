"""The table of parameters: units, ranges, integers, choices, and messages about invalid values."""

import copy
import dataclasses
import inspect
import json
import math
import pickle
import re

import numpy as np
import pytest

from labkit.cli.arguments import ParameterTexts, PathOptions
from labkit.cli.parser import Parser, on_command_line
from labkit.errors import InputError, option_name
from labkit.grains.scene import Scene
from labkit.parameters import Parameter, check_parameters, parameter, parameters_of
from labkit.paths.cycles import UndrainedCycles
from labkit.paths.element_tests import ProportionalStrain
from labkit.paths.path_file import read_path
from labkit.paths.rates import at_rate, on_grains
from labkit.paths.registry import PATHS, make_path, path_of
from labkit.paths.standard import ConstantMeanStress, ConstantVolume, CyclicConstantMeanStress
from labkit.paths.variables import increments
from labkit.quantities.conditions import condition
from labkit.records.schedule import Options
from labkit.specimens.bisection import trial_recipe
from labkit.specimens.recipe import Recipe

KINDS = [Scene, Recipe, Options, *(kind for kind in PATHS.values())]
INVALID, NO_NUMBER = "is not valid: give", "is not a number: give"


def refused(kind, **values):
    """The InputError that an instance with these values raises."""
    with pytest.raises(InputError) as error:
        kind(**values)
    return error.value


# --- units ------------------------------------------------------------------------------------------------------


PRESSURES = "Pa, kPa, MPa, GPa, N/m2, kN/m2, MN/m2, N/mm2, N/cm2, bar, kgf/cm2, psi"


@pytest.mark.parametrize(
    ("text", "pascal"),
    [
        ("0.5 MPa", 0.5e6),
        ("500 kPa", 0.5e6),
        ("500kPa", 0.5e6),
        ("5e5", 0.5e6),
        (" 5E+5 Pa ", 0.5e6),
        ("1e-3 GPa", 1e6),
        (500e3, 0.5e6),
        (1000, 1000.0),
        ("1000", 1000.0),
        ("50 Pa", 50.0),
        (".5 MPa", 0.5e6),
        ("500 kN/m2", 0.5e6),
        ("500 kN/m^2", 0.5e6),
        ("500kN/m**2", 0.5e6),
        ("500 kN/m\u00b2", 0.5e6),
        ("0.5 N/mm2", 0.5e6),
        ("0.5 MN/m2", 0.5e6),
        ("50 N/cm2", 0.5e6),
        ("5 bar", 0.5e6),
        ("5e5 N/m2", 0.5e6),
        ("10 kgf/cm2", 980_665.0),
        ("1 psi", 4.4482216152605 / 0.0254**2),
        (np.float32(1e5), 1e5),
    ],
)
def test_a_pressure_has_a_unit_or_is_in_pascal(text, pascal):
    pressure = ConstantMeanStress(pressure=text).pressure
    assert math.isclose(pressure, pascal, rel_tol=1e-14) and type(pressure) is float


@pytest.mark.parametrize(
    ("text", "metre"), [("4 mm", 4e-3), ("0.4cm", 4e-3), ("4e-3", 4e-3), ("4000 um", 4e-3), ("4000 \u00b5m", 4e-3)]
)
def test_lengths(text, metre):
    assert math.isclose(Recipe(0.67, side=text).side, metre, rel_tol=1e-15)


@pytest.mark.parametrize("text", ["0x96", "0o7", "0b1", "50 %", "20 m"])
def test_a_number_of_grains_is_a_plain_number(text):
    assert str(refused(Recipe, void_ratio=0.67, grains=text)) == f"grains {text!r} is not a number: give e.g. 20"


def test_hexadecimal_numbers_are_no_numbers_with_a_unit():
    assert "'0x96' is not a number" in str(refused(Scene, friction="0x96"))


def test_rates_densities_and_shares():
    assert ConstantMeanStress(rate="20 1/s").rate == 20.0
    assert Scene(density="2.65 t/m3").density == Scene(density="2.65 g/cm\u00b3").density == 2650.0
    assert Scene(density="2.65 g/cm3").density == 2650.0 and Scene(density="2650 kg/m3").density == 2650.0
    assert ConstantMeanStress(strain="5 %").strain == 0.05 and ConstantMeanStress(strain="5%").strain == 0.05


@pytest.mark.parametrize(
    ("kind", "field", "text", "units"),
    [
        (ConstantMeanStress, "pressure", "5 Torr", PRESSURES),
        (Scene, "mean_diameter", "1 inch", "m, cm, mm, um"),
        (ConstantMeanStress, "rate", "5 1/h", "1/s"),
        (Scene, "friction", "30 deg", "%"),
        (ConstantMeanStress, "pressure", "5 mPa", PRESSURES),
    ],
)
def test_an_unknown_unit_is_refused_and_the_known_units_are_listed(kind, field, text, units):
    unit = text.split()[1]
    error = refused(kind, **{field: text})
    assert str(error) == f"{field} {text} has an unknown unit {unit!r}: give it in {units}"
    assert (error.field, error.value, error.allowed) == (field, text, f"it in {units}")


def asked(kind, **values):
    """What labkit asks about a value that a user typed at the command line; in Python the same words are a warning."""
    (name, value), *_ = values.items()
    with pytest.raises(InputError) as error:
        parameters_of(kind)[name].require_unit(str(value))
    with pytest.warns(UserWarning, match=re.escape(str(error.value))) as warned:
        kind(**values)
    assert warned.pop(UserWarning).filename == __file__
    return error.value


@pytest.mark.parametrize("value", [0.5, "0.5", 999.9, 300, "5e-1", np.float64(0.3), 1e-300])
@pytest.mark.parametrize("name", ["cr", "cp", "cyclic_cp", "isoc", "isod"])
def test_a_bare_pressure_below_1_kpa_is_asked_back(name, value):
    error = asked(PATHS[name], pressure=value)
    number = f"{float(value):g}"
    assert error.allowed.startswith(f"{number} MPa or kPa, or {number} Pa ")
    assert error.field == "pressure" and float(error.value) == float(value)


def test_the_check_of_bare_pressures_applies_only_to_unbounded_ranges():
    assert Parameter("pressure", unit="Pa", low=1e3).doubt(0.1) is None


@pytest.mark.parametrize(
    ("name", "value", "limit", "meant"),
    [
        ("mean_diameter", 0.35, 0.1, "mm"),
        ("mean_diameter", "0.35", 0.1, "mm"),
        ("young_modulus", 70, 1e6, "GPa or MPa"),
        ("density", 2.65, 100, "g/cm3"),
    ],
)
def test_an_implausible_number_without_a_unit_is_asked_back(name, value, limit, meant):
    unit, number = parameters_of(Scene)[name].unit, f"{float(value):g}"
    said = f"has no unit, and is {'more' if float(value) > limit else 'less'} than {limit:g} {unit}"
    advice = f"give {number} {meant}, or {number} {unit} if that is meant"
    assert str(asked(Scene, **{name: value})) == f"{name} {number} {said}: {advice}"


def test_a_grading_of_stones_is_restored_from_its_text():
    scene = Scene(grading="uniform smallest=0.2m largest=0.3m")
    assert Scene.from_json(scene.to_json()) == scene and scene.sizes.largest == 0.3
    assert refused(Scene, grading="uniform smallest=0.2 largest=0.3").allowed.startswith("0.2 mm, or 0.2 m ")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    "value",
    [
        ConstantMeanStress(pressure="500 Pa"),
        ConstantVolume(strain="200 %"),
        CyclicConstantMeanStress(pressure="1 Pa", reversals="-150 %,0.1"),
        Scene(mean_diameter="20 cm"),
        Scene(young_modulus="0.5 MPa"),
        Scene(density="1 kg/m3"),
        Recipe(0.67, grains=100, pressure="500 Pa", preparation="compression"),
    ],
)
def test_a_value_in_si_units_is_never_questioned_again(value):
    """Neither by dataclasses.replace, nor when it is stored, copied, or applied to a specimen."""
    assert dataclasses.replace(value) == value == copy.deepcopy(value)
    if isinstance(value, Scene):
        assert Scene.from_json(value.to_json()) == value.replace() == value
    elif isinstance(value, Recipe):
        assert Recipe.from_json(value.to_json()) == value
        assert trial_recipe(value, 0.5, Scene()).pressure == value.pressure
    else:
        stored = json.loads(json.dumps(dataclasses.asdict(value)))
        assert path_of(value.name, stored) == value == at_rate(on_grains(value, Scene()), None)
        assert value.starting_at(1e5) == value


def test_a_warning_names_the_line_that_creates_the_value():
    @dataclasses.dataclass(frozen=True)
    class Checked(ConstantVolume):
        def __post_init__(self):
            super().__post_init__()

    for make in (Checked, ConstantVolume):
        with pytest.warns(UserWarning, match="strain 1.5 has no unit") as warned:
            make(strain=1.5)
        warning = warned.pop(UserWarning)
        assert warning.filename == __file__ and inspect.currentframe().f_lineno == warning.lineno + 2


# --- ranges -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_every_parameter_is_limited_to_its_range(kind):
    """The default is inside; values beyond either end, NaN and infinity are refused."""
    needed = {"void_ratio": "0.67"} if kind is Recipe else {}
    kind(**needed)
    for name, known in parameters_of(kind).items():
        assert known.help and known.unit != ""
        assert known.kind in (float, int, bool, str, tuple) or dataclasses.is_dataclass(known.kind)
        if known.kind not in (float, int):
            continue
        beyond = [math.nan, math.inf, -math.inf]
        beyond += [known.low - max(1.0, abs(known.low))] if math.isfinite(known.low) else []
        beyond += [known.high + max(1.0, abs(known.high))] if math.isfinite(known.high) else []
        beyond += [known.above] if math.isfinite(known.above) else []
        for value in beyond:
            error = refused(kind, **{**needed, name: value})
            assert error.field == name and (error.value == value or value != value), (name, value)
        for value in (known.low, known.high):
            if math.isfinite(value):
                assert known.read(value) == known.read(f"{value!r} {known.unit}".removesuffix(" 1")) == value


MANY = 300_000  # characters; a pattern whose time grows with the square of their number takes an hour


TEXTS = ["1" * MANY + " a\nb", "1,1" + " " * MANY + "x y", "1" * MANY + "e", " " * MANY + "x"]


@pytest.mark.parametrize("text", TEXTS, ids=["digits", "comma", "exponent", "blanks"])
def test_a_number_of_any_length_is_refused_in_one_reading(text):
    assert str(refused(Recipe, void_ratio=text))


@pytest.mark.parametrize(
    ("kind", "values", "message"),
    [
        (Scene, {"friction": -0.1}, f"friction -0.1 {INVALID} 0 to 10"),
        (Scene, {"mean_diameter": 0.0}, f"mean_diameter 0 {INVALID} 1e-09 to 1000 m"),
        (ConstantMeanStress, {"rate": 0.0}, f"rate 0 {INVALID} a number above 0, at most 1e+10 1/s"),
        (PATHS["isod"], {"strain": 0.1}, f"strain 0.1 {INVALID} a negative number from -2"),
        (ConstantMeanStress, {"strain": "nan"}, f"strain nan {INVALID} -2 to 2"),
        (ConstantMeanStress, {"strain": "far"}, f"strain 'far' {NO_NUMBER} e.g. 0.67"),
        (ConstantMeanStress, {"strain": ""}, f"strain '' {NO_NUMBER} e.g. 0.67"),
        (ConstantMeanStress, {"strain": [0.1]}, f"strain [0.1] {NO_NUMBER} -2 to 2"),
        (ConstantMeanStress, {"strain": True}, f"strain True {NO_NUMBER} -2 to 2"),
        (ConstantMeanStress, {"strain": None}, f"strain {NO_NUMBER} -2 to 2"),
        (Options, {"snapshots": -1}, f"snapshots -1 {INVALID} 0 to 1e+06"),
    ],
)
def test_the_message_names_the_field_the_value_and_the_allowed_range(kind, values, message):
    assert str(refused(kind, **values)) == message


def test_a_front_end_can_rename_the_field_in_a_message():
    error = refused(Recipe, void_ratio=0.67, step1_friction=-1)
    assert (error.field, error.value, error.allowed) == ("step1_friction", -1, "0 to 10")
    assert error.message(on_command_line) == f"--step1-friction -1 {INVALID} 0 to 10"
    assert error.message(option_name) == error.message(on_command_line) and str(error).startswith("step1_friction -1")
    assert on_command_line("path") == "path" and isinstance(error, ValueError)


# --- integers, flags, choices, lists --------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [500, "500", 500.0, "5e2", np.int64(500), "500.0"])
def test_integers(value):
    grains = Recipe(0.67, grains=value).grains
    assert grains == 500 and type(grains) is int


@pytest.mark.parametrize("value", [500.5, "500.5", math.nan, math.inf, "1e30"])
def test_numbers_that_are_not_integers_are_refused(value):
    error = refused(Recipe, void_ratio=0.67, grains=value)
    assert error.field == "grains" and str(error.value) in (str(value), str(float(value)))
    assert NO_NUMBER in str(refused(Recipe, void_ratio=0.67, seed=True))


@pytest.mark.parametrize("kind", [Scene, Recipe, Options, ConstantVolume, UndrainedCycles])
def test_a_whole_number_of_any_length_is_refused_in_one_sentence(kind):
    """Also in values that a file stored, and where Python would refuse to print the number."""
    for name, known in parameters_of(kind).items():
        if known.kind not in (float, int) or known.choices is not None:
            continue
        for value in (10**400, -(10**5000)):
            with pytest.raises(InputError, match=rf"^{name} is too large: give ") as told:
                known.read(value)
            assert len(str(told.value)) < 200


@pytest.mark.parametrize("value", [True, "true", "True", False, "FALSE"])
def test_flags(value):
    assert Scene(planar=value).planar is (str(value).lower() == "true")


@pytest.mark.parametrize("value", [1, "yes", None, 0.0])
def test_values_that_are_not_flags_are_refused(value):
    error = refused(Scene, planar=value)
    assert (error.field, error.allowed) == ("planar", "True or False")


def test_unknown_choices_are_refused_with_the_known_ones():
    for value in ("hertz", "", "paper", 3, None):
        error = refused(Scene, law=value)
        assert (error.field, error.value) == ("law", value)
        assert error.allowed.startswith("one of rolling_resistance, spring_dashpot")
    assert str(refused(Scene, law="hertz")).startswith("law 'hertz' is unknown: give one of rolling_resistance, ")


@pytest.mark.parametrize(
    "value", ["0.01,-0.01,0.02", "(0.01, -0.01, 0.02)", [0.01, -0.01, 0.02], "1%,-1%,2%", np.array([0.01, -0.01, 0.02])]
)
def test_lists_of_numbers(value):
    path = CyclicConstantMeanStress(reversals=value, pressure=1e5)
    assert path.reversals == (0.01, -0.01, 0.02) and path.strain == 0.02
    assert all(type(x) is float for x in path.reversals)


@pytest.mark.parametrize("value", [0.01, None, "up,down", ["up"], [None], [], "", [math.nan], [0.01, 0.02], "300 %"])
def test_values_that_are_not_strains_are_refused(value):
    assert refused(CyclicConstantMeanStress, reversals=value, pressure=1e5).field == "reversals"


# --- files, front ends, user-defined fields --------------------------------------------------------------------------


@pytest.mark.parametrize("name", PATHS)
def test_a_path_is_restored_from_its_file_to_the_last_bit(name):
    given = {"rate": 10.0 / 3.0, **({"pressure": "0.1 Pa"} if "pressure" in parameters_of(PATHS[name]) else {})}
    path = make_path(name, given)
    assert path_of(name, json.loads(json.dumps({**dataclasses.asdict(path), "record_strain": 1e-3}))) == path


@dataclasses.dataclass(frozen=True)
class Own:
    """User-defined parameters, one of them with a unit that labkit does not define."""

    wanted: float = parameter(help="without a default", low=0.0)
    torque: float = parameter(1.0, unit="N m", low=0.0, high=5.0, help="of the shaft")
    twice: bool = parameter(False, help="of it")
    note: str = "no parameter"

    def __post_init__(self):
        check_parameters(self)


def test_user_defined_parameters():
    assert list(parameters_of(Own)) == ["wanted", "torque", "twice"]
    assert Own(torque="2.5 N m", wanted="3", twice="true", note=7) == Own(3.0, 2.5, True, 7)
    assert refused(Own, torque="2 Nmm", wanted=1).allowed == "it in N m"
    assert refused(Own, wanted=-1).field == "wanted"


def test_the_command_line_has_every_parameter_with_its_unit_and_default():
    parser = Parser("labkit")
    ParameterTexts(Recipe, "specimen").add(parser)
    ParameterTexts(Scene, "material").add(parser)
    text = " ".join(parser.format_help().split())
    for name, known in (parameters_of(Recipe) | parameters_of(Scene)).items():
        assert (f"{option_name(name)} " in text) == known.option, name
    assert "--mean-diameter" in text and "mean diameter D of the grains in m (default: 0.00017)" in text
    assert "one of rolling_resistance, spring_dashpot" in text and "--planar" not in text


def test_the_help_of_an_option_lists_differences_between_paths():
    parser = Parser("labkit")
    PathOptions().add(parser)
    text = " ".join(parser.format_help().split())
    grains = "for D = 0.17 mm and rho = 2650 kg/m3, scaled with 1/(D sqrt(rho)) for other grains)"
    assert (
        f": axial strain rate in 1/s (default: 10 {grains}" in text
        and "cv, cr, cp, cyclic_cp, c1, true_triaxial" in text
    )
    assert f"isoc, isotropic_reloading: strain rate in each direction in 1/s (default: 5 {grains}" in text
    assert f"isod: strain rate in each direction in 1/s (default: 2.5 {grains}" in text
    assert "cr, cp, cyclic_cp, c1, true_triaxial, plane_strain, simple_shear, stress_rotation, drained_cycles" in text


def test_a_class_shows_the_arguments_of_its_init():
    """Notebooks and the reference show these; a misspelled name is an InputError, and so is a missing one."""
    assert list(inspect.signature(Recipe).parameters)[:2] == ["void_ratio", "step1_friction"]
    assert copy.deepcopy(Scene(friction=0.3)) == pickle.loads(pickle.dumps(Scene(friction=0.3)))
    with pytest.raises(InputError, match=r"^void_ratio is missing: give one, e\.g\. 0\.67$"):
        Recipe(grains=500)


def test_increments_may_have_units():
    plain = increments(strain={"zz": 0.01}, stress={"xx": 40e3})
    assert increments(strain={"zz": "1 %"}, stress={"xx": "40 kPa"}) == plain
    with pytest.raises(InputError, match=r"^xx 40 mPa .*Pa, kPa"):
        increments(stress={"xx": "40 mPa"})


@pytest.mark.parametrize(
    "kind, field, value, allowed",
    [
        (ConstantVolume, "strain", 2, "2 % or 200 %"),
        (ConstantVolume, "strain", "-1.5", "-1.5 % or -150 %"),
        (CyclicConstantMeanStress, "reversals", "0.5,-2", "-2 % or -200 %"),
    ],
)
def test_a_strain_above_1_is_asked_back(kind, field, value, allowed):
    found = asked(kind, **{field: value})
    assert (found.field, found.problem, found.allowed) == (field, "has no unit", allowed)


@pytest.mark.parametrize(
    "kind, field, value",
    [(ConstantVolume, "strain", 5), (UndrainedCycles, "strain_limit", 5), (Options, "record_strain", 2)],
)
def test_a_strain_out_of_range_is_refused_with_the_percentage(kind, field, value):
    assert f"{value} %" in refused(kind, **{field: value}).allowed
    with pytest.raises(InputError, match="has no unit"):
        parameters_of(kind)[field].require_unit(str(value))


@pytest.mark.filterwarnings("error")
def test_a_strain_above_1_with_a_unit_is_taken():
    path = ConstantVolume(strain="200 %")
    assert path.strain == 2.0 and path.starting_at(1e5).strain == 2.0 and ConstantVolume(strain=1.0).strain == 1.0
    assert ProportionalStrain(ratios=(0.0, 0.0, 2.0)).ratios[2] == 2.0  # not a strain
    assert increments(strain={"zz": "200 %"}).strains[0, 2, 2] == 2.0
    with pytest.warns(UserWarning, match=r"^zz 2 has no unit: give 2 % or 200 %$") as warned:
        increments(strain={"zz": 2})
    assert warned.pop(UserWarning).filename == __file__


@pytest.mark.parametrize("strain", ["2", "[0.01, 2]"])
def test_a_path_file_asks_for_the_unit_of_a_strain(strain, tmp_path):
    file = tmp_path / "p.yaml"
    file.write_text(f"path: steps\nsteps:\n  - strain: {{zz: {strain}}}\n")
    with pytest.raises(InputError, match=r"p\.yaml"):
        read_path(file)
    file.write_text("path: steps\nsteps:\n  - {strain: {zz: 200 %}, over: 300 %}\n")
    assert read_path(file).steps[0].strains[0, 2, 2] == 2.0


@pytest.mark.parametrize("text", ["abs(axial_strain) > 5", "-gamma_xz > 5", "strain_zz - strain_xx < -2"])
def test_a_condition_asks_for_the_unit_of_a_strain(text):
    with pytest.raises(InputError, match=r"has no unit: write -?\d % or -?\d00 %"):
        condition(text)
    assert condition(text + " %") and condition("q/p > 5 or axial_strain > 1")


@pytest.mark.parametrize("typed", ["1", " 1", "-1", "+1"])
def test_a_strain_typed_as_1_is_asked_for_its_unit(typed):
    assert "%" in asked(ConstantVolume, strain=typed).allowed
    assert ConstantVolume(strain="1.0").strain == ConstantVolume(strain="100 %").strain == 1.0


@pytest.mark.parametrize(
    "text, said",
    [
        ("300 kpa", "give 300 kPa"),
        ("0.3 MPA", "give 0.3 MPa"),
        ("300 000", "is not a number"),
        ("300_000 Pa", "is not a number"),
        ("1,000,000", "is not a number"),
        ("300-400 kPa", "is not a number"),
        ("1,000 kPa", "give 1.000 kPa or 1000 kPa"),
        ("300 furlongs", "has an unknown unit"),
    ],
)
def test_a_pressure_is_refused_for_its_own_reason(text, said):
    assert said in str(refused(ConstantMeanStress, pressure=text))
