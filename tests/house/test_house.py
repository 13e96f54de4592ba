"""House rules: public names are typed and documented, functions and files are short, imports go to lower layers only.

Also, `import labkit` loads no library.
"""

from __future__ import annotations

import argparse
import ast
import graphlib
import importlib
import inspect
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

import labkit
from labkit.plugins import PLUGINS, plugin_of
from tests.house.source import (
    LABKIT,
    ROOT,
    files,
    functions,
    imports,
    inherited_private_names,
    is_public,
    name_of,
    private_names,
    public,
    tree,
)

# Layers from the bottom up. A package imports only itself and lower layers, no other package of its own layer.
LAYERS = (
    ("version", "errors", "once", "units", "parameters", "extensions", "lazy", "plugins"),
    ("process",),
    ("text",),
    ("files",),
    ("bodies",),
    ("micro",),
    ("sff",),
    ("grains",),
    ("quantities",),
    ("paths",),
    ("servo",),
    ("records",),
    ("engines",),
    ("specimens",),
    ("results",),
    ("simulation",),
    ("model",),
    ("figures",),
    ("cli",),
    tuple(plugin for plugin in PLUGINS if plugin.startswith("plugins.")),
    ("__main__",),
)
BOTTOM = 0
LAYER = {package: number for number, packages in enumerate(LAYERS) for package in packages}
PACKAGES = [package for package in LAYER if (LABKIT / package.replace(".", "/")).is_dir()]

LONGEST_FUNCTION = 80  # lines
LONGEST_FILE = 350
MOST_ARGUMENTS = 8

# Where a heavy library may be imported. YADE's interpreter, which imports the other packages, has no Numba.
ALLOWED = {
    "numba": (),  # labkit.engines.kernel.translate imports it when something must be compiled
    "llvmlite": ("engines/kernel",),
    "matplotlib": (
        "figures",
        *(f"plugins/{name}" for name in "calibration campaigns pictures probes".split()),
    ),
}


ARRAYS = re.compile(r"^(?!.*Callable).*(ndarray|DataFrame|\b(xarray|xr)\.Data)")  # annotations of arrays


def package_of(file: Path) -> str:
    """The package of labkit that contains a file, or the name of a module directly in labkit/."""
    return room_of(file.relative_to(LABKIT).with_suffix("").parts)


def room_of(names: Sequence[str]) -> str:
    """The entry of LAYERS to which the names of a module below labkit belong."""
    inner = ".".join(names[:2])
    return inner if inner in LAYER else names[0]


def test_every_package_belongs_to_a_layer():
    packages = {package_of(file) for file in files("labkit")} - {"__init__"}
    assert packages == set(LAYER)


def test_public_functions_are_typed():
    assert [str(name) for name in public("labkit", "analysis", "benchmarks") if not name.typed] == []


def test_public_names_are_documented():
    assert [str(name) for name in public("labkit") if not name.documented] == []


def test_files_start_with_a_docstring():
    texts = {name_of(file): file.read_text() for file in files("labkit")}
    assert [name for name, text in texts.items() if not text.startswith('"""')] == []
    modules = {name: text for name, text in texts.items() if not name.endswith("__init__.py")}
    assert [name for name, text in modules.items() if "from __future__ import annotations" not in text] == []


def test_functions_and_files_are_short():
    everything = files("labkit", "analysis", "benchmarks", "yade_scripts", "examples")
    lengths = {name_of(file): len(file.read_text().splitlines()) for file in everything}
    for file in everything:
        for node in functions(file):
            lengths[f"{name_of(file)}:{node.lineno} {node.name}"] = node.end_lineno - node.lineno + 1
    longest = {name: LONGEST_FUNCTION if " " in name else LONGEST_FILE for name in lengths}
    assert {name: lines for name, lines in lengths.items() if lines > longest[name]} == {}


def test_functions_have_few_arguments():
    """Those of the front door may have more, by keyword."""
    counts = {}
    for file in files("labkit"):
        for node in functions(file):
            by_keyword = [] if node.name in labkit.__all__ else node.args.kwonlyargs
            names = [one.arg for one in (*node.args.posonlyargs, *node.args.args, *by_keyword)]
            counts[f"{name_of(file)}:{node.lineno} {node.name}"] = len(names) - (names[:1] in (["self"], ["cls"]))
    assert {name: number for name, number in counts.items() if number > MOST_ARGUMENTS} == {}


def test_every_python_that_is_started_ignores_the_current_folder():
    """It may be a stranger's. Numba's own cache would be another way to load code from there."""
    started = re.compile(r"""(sys\.executable|[{"]python[^"]*?)"?, *"-[mc]"|python:q} -[mc]|cache=True""")
    texts = {
        file: file.read_text() for file in (*files("labkit", "yade_scripts"), LABKIT / "plugins/campaigns/Snakefile")
    }
    assert {file: found[0] for file, text in texts.items() if (found := started.search(text))} == {}


def test_imports_go_to_lower_layers_only():
    """Modules directly in labkit/ import only one another. Imports for type checkers count too.

    A package may list names of plug-ins among its own: `attach` leaves them out when the plug-in is deleted.
    """
    upwards = []
    for file in files("labkit"):
        own = package_of(file)
        layer = BOTTOM + 1 if own in (*LAYERS[BOTTOM], "__init__") else LAYER[own]
        for line, module in imports(file, for_types=file.parent != LABKIT or file.name != "__init__.py"):
            package, *rest = module.split(".")
            if file.name == "__init__.py" and plugin_of(module):
                continue
            if package == "labkit" and (not rest or (room_of(rest) != own and LAYER[room_of(rest)] >= layer)):
                upwards.append(f"{name_of(file)}:{line} imports {module}")
    assert upwards == []


def test_no_room_of_the_core_imports_a_plugin():
    core = [
        file for file in files("labkit") if plugin_of(".".join(file.relative_to(ROOT).with_suffix("").parts)) is None
    ]
    assert [(name_of(file), module) for file in core for _, module in imports(file) if plugin_of(module)] == []


def test_modules_import_each_other_without_circles():
    """This covers imports at the top of a file and inside functions."""
    modules = {".".join(file.relative_to(ROOT).with_suffix("").parts): file for file in files("labkit")}
    graph = {name: {found for _, found in imports(file)} - {name} for name, file in modules.items()}
    assert list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, which names the modules


def test_heavy_libraries_are_imported_only_where_allowed():
    for library, folders in ALLOWED.items():
        users = [
            file.relative_to(LABKIT)
            for file in files("labkit")
            if library in {module.split(".")[0] for _, module in imports(file)}
        ]
        assert [(library, str(file)) for file in users if not any(map(file.is_relative_to, folders))] == []


def test_labkit_does_not_import_its_users():
    for file in files("labkit"):
        packages = {module.split(".")[0] for _, module in imports(file)}
        assert not packages & {"analysis", "benchmarks", "examples", "tests", "yade_scripts"}, name_of(file)


def test_integers_of_the_engine_have_64_bits_on_any_computer():
    """NumPy's own integer has 32 bits where pointers do, as in a browser."""
    engine = [*files("labkit/engines/kernel"), LABKIT / "engines/fused.py", LABKIT / "servo/plan.py"]
    calls = [(file, node) for file in engine for node in ast.walk(tree(file)) if isinstance(node, ast.Call)]
    of_int = [
        f"{name_of(file)}:{node.lineno}"
        for file, node in calls
        if isinstance(node.func, ast.Attribute)  # such as np.zeros or values.astype
        and any(ast.unparse(value) == "int" for value in (*node.args, *(word.value for word in node.keywords)))
    ]
    assert of_int == []


def test_compilers_are_used_by_their_public_names_only():
    """Numba's `core` and `np` and names with an underscore may change with any release."""
    private = re.compile(
        r"numba\.(core|np|_)|llvmlite\.\w+\._|(numba|llvm)\._"
        r"|_numba_type_|\b_cache(_file)?\b|enable_caching|__class__\b[^=\n]*=[^=]"
    )
    texts = {name_of(file): file.read_text() for file in files("labkit")}
    assert {name: found[0] for name, text in texts.items() if (found := private.search(text))} == {}


def test_only_a_file_itself_uses_its_private_names():
    """Names that begin with an underscore are neither imported nor taken from an object of another file or library."""
    assert {name_of(file): found for file in files("labkit") if (found := private_names(tree(file)))} == {}


def test_no_class_uses_private_names_that_it_inherits_from_a_library():
    modules = (".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files("labkit"))
    loaded = [importlib.import_module(name) for name in modules if not name.endswith(("__main__", "__init__"))]
    classes = {kind for module in loaded for kind in vars(module).values() if inspect.isclass(kind)}
    own = [kind for kind in classes if kind.__module__.startswith("labkit.")]
    assert {kind.__name__: found for kind in own if (found := inherited_private_names(kind))} == {}


def test_private_names_of_libraries_are_found():
    class Formatter(argparse.HelpFormatter):
        def _fill_text(self, text, width, indent):
            return text

    class Parser(argparse.ArgumentParser):
        def options(self):
            return self._actions

    assert [inherited_private_names(kind) for kind in (Formatter, Parser)] == [{"_fill_text"}, {"_actions"}]
    text = "from x import _v, path\nx._replace(y._z, self._q)\ngetattr(x, '_w')\ndef _own(): x._own"
    assert private_names(ast.parse(text)) == {"_v", "_z", "_w"}


def test_netcdf_files_are_opened_in_one_place():
    """labkit.files.netcdf checks the hashes of what labkit.files.opening opens; xarray reads only what has passed."""
    users = {name_of(file) for file in files("labkit") if "netCDF4.Dataset(" in file.read_text()}
    assert users == {"labkit/files/opening.py"}
    for file in files("labkit"):
        text = file.read_text()
        opened = re.findall(
            r"(?:NetCDF4DataStore(?:\.open)?\(|engine=\"netcdf4\").*", text
        )  # xarray's own lock would block
        assert all("lock=LIBRARY" in line for line in opened), name_of(file)
        assert text.count(".open_dataset(") <= text.count("open_netcdf(") + text.count("name_damage("), name_of(file)


@pytest.mark.slow
def test_import_labkit_loads_no_library():
    libraries = {"numpy", "matplotlib", "xarray", "numba"}
    code = f"import sys, labkit; dir(labkit); print(*sorted({libraries} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_public_names_resolve():
    for package in ("labkit", *(f"labkit.{name}" for name in PACKAGES)):
        module = importlib.import_module(package)
        names = getattr(module, "__all__", [])
        assert set(names) <= set(dir(module)) and not {"TYPE_CHECKING", "attach"} & set(dir(module))
        for name in {*names, *dir(module)}:
            getattr(module, name)


def test_no_public_class_or_function_is_defined_twice():
    nodes = [node for file in files("labkit") for node in tree(file).body]
    names = [node.name for node in nodes if isinstance(node, ast.ClassDef | ast.FunctionDef) and is_public(node.name)]
    assert sorted(names) == sorted(set(names))


def test_a_value_that_holds_arrays_equals_only_itself():
    """The comparison of its fields would be an array, which is neither true nor false."""
    wrong = []
    for node in (node for file in files("labkit") for node in ast.walk(tree(file)) if isinstance(node, ast.ClassDef)):
        fields = [ast.unparse(one.annotation) for one in node.body if isinstance(one, ast.AnnAssign)]
        made = " ".join(map(ast.unparse, node.decorator_list))
        if "dataclass" in made and "eq=False" not in made and any(map(ARRAYS.match, fields)):
            wrong.append(node.name)
    assert wrong == []


def test_names_use_the_words_of_the_glossary():
    glossary = (ROOT / "ARCHITECTURE.md").read_text().partition("## Words")[2].partition("## ")[0]
    rows = [line.split("|")[1:-1] for line in glossary.splitlines() if line.startswith("| ")][1:]
    others = {word.strip() for *_, avoid in rows for word in avoid.split(",") if word.strip()}
    nodes = [(file, node) for file in files("labkit") for node in ast.walk(tree(file))]
    names = [(name_of(file), getattr(node, "id", getattr(node, "arg", None))) for file, node in nodes]
    names += [(name_of(file), getattr(node, "name", getattr(node, "attr", None))) for file, node in nodes]
    assert len(rows) > 10 and {(file, name) for file, name in names if name and others & {*name.split("_")}} == set()
