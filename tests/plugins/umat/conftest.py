"""The compiled material law; its tests are skipped where a compiler is missing."""

import pytest

from labkit.model.parameters import Model
from labkit.plugins.umat import library
from labkit.plugins.umat.library import Library, write
from labkit.plugins.umat.props import PointStart, properties


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A folder with the files of `labkit umat --build`."""
    missing = library.missing_compilers()
    if missing:
        pytest.skip(f"{' and '.join(missing)} not installed: apt-get install gfortran gcc")
    folder = tmp_path_factory.mktemp("umat")
    write(folder, properties(Model(), PointStart(0.67, 0.5e6)))
    library.build(folder)
    return folder


@pytest.fixture(scope="session")
def shared_library(folder):
    """The file of the compiled law."""
    return folder / library.NAME


@pytest.fixture
def load(shared_library):
    """A function that loads the law with the constants of a model; further arguments as those of Library."""
    return lambda model, *arguments, **options: Library(shared_library, model, *arguments, **options)


@pytest.fixture(scope="session")
def model():
    """Table 2 with the default interpretations."""
    return Model()
