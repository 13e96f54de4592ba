"""The pages of the reference that are derived from the code: commands, parameters, files, campaign keys and API.

Those in `stored` are in the repository, so that they can be read without the site. After a change of the code:

    PYTHONPATH=docs python -m site_pages.reference
"""

import dataclasses
import importlib
import inspect
import types
import typing
from pathlib import Path

from labkit.bodies.clumps import Clumps
from labkit.cli.dispatch import parser_for
from labkit.cli.parser import summary_of
from labkit.cli.registry import find_command, summaries
from labkit.errors import as_typed
from labkit.files import schema
from labkit.grains.laws import LAWS
from labkit.grains.scene import Scene
from labkit.model.parameters import Model, Parameters, Readings
from labkit.parameters import parameters_of
from labkit.paths.registry import PATHS
from labkit.plugins.campaigns import keys
from labkit.plugins.exchange.formats import FORMATS
from labkit.records.schedule import Options
from labkit.results.figures import FIGURES
from labkit.specimens.recipe import Recipe
from labkit.units import UNITS
from site_pages.repository import write_if_changed

PACKAGES = ("labkit", "labkit.micro", "labkit.sff", "labkit.grains", "labkit.quantities", "labkit.paths",
            "labkit.servo", "labkit.records", "labkit.specimens", "labkit.engines", "labkit.results",
            "labkit.simulation", "labkit.model", "labkit.plugins.exchange", "labkit.plugins.umat",
            "labkit.plugins.campaigns", "labkit.figures")  # fmt: skip
LAW_PARTS = ("law", "parts", "contact", "pair", "normal", "tangential", "rolling", "damping", "kinematics")
EQUATIONS = ("labkit.model.equations", "labkit.model.differentials", "labkit.model.rates",
             "labkit.model.stiffness", "labkit.sff.c0", "labkit.micro.fabric",
             "labkit.micro.size_groups",
             "labkit.servo.correction", *(f"labkit.grains.laws.{part}" for part in LAW_PARTS))  # fmt: skip


def write(folder: Path) -> None:
    """Write all derived pages into the folder of the reference."""
    built = {
        "commands": commands(),
        **{f"api/{name}": package(name) for name in PACKAGES},
        **{f"api/{name}": module(name) for name in EQUATIONS},
    }
    for left in set((folder / "generated").rglob("*.md")) - {folder / "generated" / f"{name}.md" for name in built}:
        left.unlink()  # the page of a module that is gone
    for name, text in built.items():
        write_if_changed(folder / "generated" / f"{name}.md", text)
    write_stored(folder)


def write_stored(folder: Path) -> None:
    """Write the derived pages that are in the repository."""
    for name, text in stored().items():
        write_if_changed(folder / f"{name}.md", text)


def stored() -> dict[str, str]:
    """The derived pages that are in the repository, name -> text."""
    return {"parameters": parameters(), "paths": paths(), "campaign_keys": campaign_keys(), "files": files()}


# --- command line ----------------------------------------------------------------------------------------------------


def commands() -> str:
    """The help text of every command."""
    sections = ["# Commands", "The help texts of `labkit COMMAND --help`."]
    for name in summaries():
        command = find_command(name)
        text = parser_for(command, ["--help"]).format_help()
        sections += [f"(command-{name})=\n## {name}", command.description, f"```text\n{text}```"]
    return "\n\n".join(sections) + "\n"


# --- parameters ------------------------------------------------------------------------------------------------------


def _table(header, rows) -> str:
    cells = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in cells)


def _parameters(known) -> str:
    """A table of parameters: option, default, meaning, what is allowed."""
    rows = [(f"`{name}`", _default(one), _plain(one.help), _plain(one.allowed_values)) for name, one in known.items()]
    return _table(("name", "default", "meaning", "allowed"), rows)


def _default(known) -> str:
    if known.default is dataclasses.MISSING or known.default is None:
        return "required" if known.default is dataclasses.MISSING else ""
    return f"`{as_typed(known.default)}`" + (f" {known.unit}" if known.unit != "1" else "")


def _plain(text) -> str:
    """The text with Markdown's characters escaped, except within `code`."""
    parts = str(text).split("`")
    parts[::2] = [
        part.replace("<", "&lt;").replace("*", "\\*").replace("~", "\\~").replace("_", "\\_") for part in parts[::2]
    ]
    return "`".join(parts)


def parameters() -> str:
    """Parameters of Scene, Recipe and Options, and of the model."""
    parts = [
        "# Parameters",
        "The name is the Python argument, the campaign key and, with `-` instead of `_`, the option of the command "
        "line. A value is a number in SI units or text with a unit, such as `500 kPa`.",
        "Units: " + "; ".join(", ".join(f"`{name}`" for name in names) for names in UNITS.values()) + ".",
        "(parameters-scene)=\n## Scene: the material", _parameters(parameters_of(Scene)),
        "(parameters-recipe)=\n## Recipe: the specimen", _parameters(parameters_of(Recipe)),
        "(parameters-options)=\n## Options: what a run records", _parameters(parameters_of(Options)),
        "## Contact laws", _table(("name", "law"), [(f"`{n}`", _plain(summary_of(LAWS[n]))) for n in LAWS]),
        "(parameters-model)=\n## The constitutive model (Table 2)", _fields(Parameters()),
        "## Readings of the model", _fields(Readings()),
        "## Model", f"Its fields: {', '.join(f'`{field.name}`' for field in dataclasses.fields(Model))}.",
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _fields(value) -> str:
    rows = [(f"`{field.name}`", f"`{as_typed(getattr(value, field.name))}`") for field in dataclasses.fields(value)]
    return _table(("name", "default"), rows)


def paths() -> str:
    """Parameters of every loading path."""
    parts = ["# Loading paths", "Each is a class of `labkit.paths`; see also [path files](../paths.md)."]
    for name in PATHS:
        kind = PATHS[name]
        parts += [f"(path-{name})=\n## `{name}`", f"`{kind.__name__}`: {_plain(summary_of(kind))}."]
        parts.append(_parameters(keys.options_of(kind)) if keys.options_of(kind) else "No parameters.")
    return "\n\n".join(parts) + "\n"


def campaign_keys() -> str:
    """Keys of a campaign file: those of other tables by name, the others in tables."""
    run = {name: one for name, one in keys.any_run_keys().items() if name != "path"}  # its choices: the page of paths
    parts = [
        "# Keys of a campaign file",
        "See [campaigns](../campaigns.md) for an example. Every key of an entry but `path` and `from` may be a list "
        "of values; lists expand to all combinations. Keys that are also parameters of Python are explained in "
        "[Parameters](parameters.md).",
        "## Top of the file: name, and defaults of all entries", _keys(keys.file_keys()),
        "## `specimens:` a specimen to make", _keys(keys.specimen_keys(), keys.file_keys()),
        "## `specimens:` a specimen consolidated from another", _keys(keys.consolidated_keys(), keys.file_keys()),
        "## `runs:` keys of every run",
        "In addition each run has `path`, one of the [loading paths](paths.md), and the parameters of its path.",
        _keys(run, keys.file_keys()),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _keys(known, of_file=types.MappingProxyType({})) -> str:
    """The names of the keys that another table explains, and a table of the others."""
    kinds = {"scene": Scene, "recipe": Recipe, "options": Options}
    lines, rest = [], dict(known)
    for label, kind in kinds.items():
        same = {name for name, one in parameters_of(kind).items() if name in rest and rest[name].help == one.help}
        names = ", ".join(f"`{name}`" for name in rest if name in same)
        rest = {name: one for name, one in rest.items() if name not in same}
        lines += [f"- [{kind.__name__}](parameters.md#parameters-{label}): {names}"] * bool(names)
    above = [f"`{name}`" for name in rest if name in of_file]
    lines += [f"- as at the top of the file: {', '.join(above)}"] * bool(above)
    own = {name: one for name, one in rest.items() if name not in of_file}
    return "\n\n".join(["\n".join(lines), *([_parameters(own)] if own else [])])


# --- files -----------------------------------------------------------------------------------------------------------


def files() -> str:
    """Variables and attributes of state and run files."""

    def table(variables):
        rows = [
            (f"`{v.name}`", ", ".join(v.dimensions), v.dtype, v.units, _plain(v.long_name)) for v in variables.values()
        ]
        return _table(("variable", "dimensions", "type", "units", "meaning"), rows)

    attributes = [(f"`{name}`", kind, meaning) for name, ((_, kind), meaning) in schema.ATTRIBUTES.items()]
    sizes = ", ".join(f"{name} = {size}" for name, size in schema.SIZES.items())
    essential = ", ".join(f"`{name}`" for name in schema.ESSENTIAL)
    parts = [
        "# Files",
        f"All files are netCDF-4 and follow {schema.CONVENTIONS}. {schema.COMMENT} SI units; {sizes}. "
        "Each file also contains the labels of i and j. "
        "Each file ends with the SHA-256 of all its bytes, which is checked before it is read.",
        "(file-state)=\n## State files `*.state.nc`", table(schema.STATE),
        "With clumps also:", table(Clumps.table),
        "With cohesion or bonds, also in the group `contacts` of a run:", table(schema.HISTORY),
        "(file-run)=\n## Run files `*.run.nc`",
        f"Root group: one value per record. A run file must contain {essential}; others read as NaN if missing.",
        table(schema.RECORD),
        "The equation by volume, which files of earlier versions lack:", table(schema.BY_VOLUME),
        "With clumps:", table(schema.ECCENTRICITY),
        "With cohesion or bonds:", table(schema.LOSSES),
        "Group `contacts`: snapshots, as contiguous ragged arrays.", table(schema.CONTACTS),
        "Group `grains`.", table(schema.GRAINS), "With clumps also:", table(Clumps.of_run),
        "## Attributes", _table(("attribute", "is", "meaning"), attributes),
        "## Formats of other programs",
        _table(("format", "what is read or written"), [(f"`{n}`", _plain(summary_of(FORMATS[n]))) for n in FORMATS]),
        "## Figures", _table(("figure", "shows"), [(f"`{n}`", _plain(summary_of(FIGURES[n]))) for n in FIGURES]),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


# --- API -------------------------------------------------------------------------------------------------------------


def package(name: str) -> str:
    """The public names of a package."""
    loaded = importlib.import_module(name)
    names = [n for n in getattr(loaded, "__all__", []) if not n.startswith("__")]
    if not names:
        names = sorted(n for n, v in vars(loaded).items() if not n.startswith("_") and _own(v, name))
    return _api(name, loaded, names)


def module(name: str) -> str:
    """The public functions and classes of a module that holds equations."""
    loaded = importlib.import_module(name)
    public = {n: v for n, v in vars(loaded).items() if not n.startswith("_") and getattr(v, "__module__", "") == name}
    names = [n for n, v in public.items() if not isinstance(v, typing.TypeVar)]
    return _api(name, loaded, names)


def _own(value, name) -> bool:
    return callable(value) and str(getattr(value, "__module__", "")).startswith(name)


def _api(name: str, loaded, names) -> str:
    """A table of the names, and the documentation of those that no earlier page has."""
    documented = {one: _short(name, one, getattr(loaded, one)) for one in names}
    own = [one for one in names if documented[one] == f"{name}.{one}"]
    lines = [f"# {name}", "", "```{eval-rst}", f".. automodule:: {name}", "   :no-members:", "",
             f".. currentmodule:: {name}", "", ".. autosummary::", "   :nosignatures:", ""]  # fmt: skip
    lines += [
        f"   {'' if one in own else '~'}{one if one in own else documented[one]}" for one in names if documented[one]
    ]
    for one in own:
        lines += ["", _directive(one, getattr(loaded, one))]
    return "\n".join([*lines, "```", ""])


def _short(package: str, name: str, value) -> str:
    """The name under which an object is documented: that of the first package that has it. Empty for a module."""
    if isinstance(value, types.ModuleType):
        return ""
    for earlier in PACKAGES:
        loaded = importlib.import_module(earlier)
        if name in getattr(loaded, "__all__", ()) and getattr(loaded, name) is value:
            return f"{earlier}.{name}"
        if earlier == package:
            break
    return f"{package}.{name}"


def _directive(name: str, value) -> str:
    if inspect.isclass(value):
        return f".. autoclass:: {name}\n   :members:"
    if callable(value):
        return f".. autofunction:: {name}"
    return f".. autodata:: {name}\n   :no-value:"


if __name__ == "__main__":
    write_stored(Path(__file__).parents[1] / "reference")
