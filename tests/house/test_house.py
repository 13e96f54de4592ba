"""House rules: public names are typed and documented, functions and files are short, imports go to lower layers only.

Also, `import labkit` loads no library.
"""

from __future__ import annotations

import graphlib
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

import labkit
from labkit.plugins import plugin_of
from tests.house.source import LABKIT, ROOT, files, functions, imports, name_of, public

# Layers from the bottom up. A package imports only itself and lower layers, no other package of its own layer.
LAYERS = (
    ("errors", "parameters", "extensions", "lazy", "plugins", "former", "dem", "campaign", "visuals"),
    ("io",),
    ("micro",),
    ("sff",),
    ("grains",),
    ("quantities",),
    ("paths",),
    ("servo",),
    ("records",),
    ("engines",),
    ("specimens",),
    ("runs",),
    ("model",),
    ("campaigns",),
    ("figures",),
    ("cli",),
    ("exchange", "incremental", "umat"),  # plug-ins
)
BOTTOM = 0
LAYER = {package: number for number, packages in enumerate(LAYERS) for package in packages}
PACKAGES = [package for package in LAYER if (LABKIT / package).is_dir()]

LONGEST_FUNCTION = 80  # lines
LONGEST_FILE = 350

# Where a heavy library may be imported. YADE's interpreter, which imports the other packages, has no Numba.
ALLOWED = {
    "numba": ("engines/kernel", "engines/fused.py", "engines/cuda", "model", "figures/render.py"),
    "llvmlite": ("engines/kernel",),
    "matplotlib": ("figures",),
}


def package_of(file: Path) -> str:
    """The package of labkit that contains a file, or the name of a module directly in labkit/."""
    return file.relative_to(LABKIT).parts[0].removesuffix(".py")


def test_every_package_belongs_to_a_layer():
    packages = {package_of(file) for file in files("labkit")} - {"__init__"}
    assert packages == set(LAYER)


@pytest.mark.parametrize("folder", ["labkit", "analysis", "benchmarks"])
def test_public_functions_are_typed(folder):
    assert [str(name) for name in public(folder) if not name.typed] == []


def test_public_names_are_documented():
    assert [str(name) for name in public("labkit") if not name.documented] == []


@pytest.mark.parametrize("file", files("labkit"), ids=name_of)
def test_files_start_with_a_docstring(file):
    text = file.read_text()
    assert text.startswith('"""')
    assert "from __future__ import annotations" in text or file.name == "__init__.py"


@pytest.mark.parametrize("file", files("labkit", "analysis", "benchmarks", "yade_scripts", "examples"), ids=name_of)
def test_functions_and_files_are_short(file):
    lengths = {f"{node.name}, line {node.lineno}": node.end_lineno - node.lineno + 1 for node in functions(file)}
    assert {name: length for name, length in lengths.items() if length > LONGEST_FUNCTION} == {}
    assert len(file.read_text().splitlines()) <= LONGEST_FILE


@pytest.mark.parametrize("file", [file for file in files("labkit") if file.parent != LABKIT], ids=name_of)
def test_imports_go_to_lower_layers_only(file):
    own = package_of(file)
    for line, module in imports(file):
        package, *rest = module.split(".")
        if package == "labkit" and rest and rest[0] != own:
            assert LAYER[rest[0]] < LAYER[own], f"line {line}: {own} imports {module}"


@pytest.mark.parametrize("file", files("labkit"), ids=name_of)
def test_no_room_of_the_core_imports_a_plugin(file):
    own = plugin_of(".".join(file.relative_to(ROOT).with_suffix("").parts))
    if own is None:
        assert [module for _, module in imports(file) if plugin_of(module)] == []


@pytest.mark.parametrize("file", sorted(LABKIT.glob("*.py")), ids=name_of)
def test_the_base_modules_import_no_package(file):
    for line, module in imports(file):
        package, *rest = module.split(".")
        assert package != "labkit" or not rest or LAYER[rest[0]] == BOTTOM, f"line {line}: imports {module}"


def test_modules_import_each_other_without_circles():
    """Whether at the top of a file or inside a function."""
    modules = {".".join(file.relative_to(ROOT).with_suffix("").parts): file for file in files("labkit")}
    graph = {name: {found for _, found in imports(file)} - {name} for name, file in modules.items()}
    assert list(graphlib.TopologicalSorter(graph).static_order())  # raises CycleError, which names the modules


@pytest.mark.parametrize("library", ALLOWED)
def test_heavy_libraries_are_imported_only_where_allowed(library):
    users = {
        file.relative_to(LABKIT)
        for file in files("labkit")
        for _, module in imports(file)
        if module.split(".")[0] == library
    }
    allowed = [Path(folder) for folder in ALLOWED[library]]
    assert {str(file) for file in users if not any(file.is_relative_to(folder) for folder in allowed)} == set()


def test_labkit_does_not_import_its_users():
    for file in files("labkit"):
        packages = {module.split(".")[0] for _, module in imports(file)}
        assert not packages & {"analysis", "benchmarks", "examples", "tests", "yade_scripts"}, name_of(file)


def test_netcdf_files_are_opened_in_one_place():
    """labkit.io.netcdf checks the hashes; xarray reads only what passed there."""
    users = {name_of(file) for file in files("labkit") if "netCDF4.Dataset(" in file.read_text()}
    assert users == {"labkit/io/netcdf.py"}
    for file in files("labkit"):
        text = file.read_text()
        assert text.count("open_dataset(") <= text.count("open_netcdf(") + text.count("damage_named("), name_of(file)


def test_import_labkit_loads_no_library():
    libraries = {"numpy", "matplotlib", "xarray", "numba"}
    code = f"import sys, labkit; dir(labkit); print(*sorted({libraries} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_a_run_starts_without_xarray():
    """It costs a third of a second; only who reads the run file needs it."""
    code = "import sys, labkit.cli.simulate, labkit.runs.tasks, labkit.engines.fused; print('xarray' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize("package", ["labkit", *(f"labkit.{name}" for name in PACKAGES)])
def test_public_names_resolve(package):
    module = importlib.import_module(package)
    names = getattr(module, "__all__", [])
    assert set(names) <= set(dir(module))
    for name in {*names, *dir(module)}:
        getattr(module, name)


def test_labkit_exports_every_name_once():
    assert len(labkit.__all__) == len(set(labkit.__all__))
    with pytest.raises(AttributeError, match="no attribute 'missing_name'"):
        _ = labkit.missing_name
