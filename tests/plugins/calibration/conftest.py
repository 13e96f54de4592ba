import pytest

from labkit.model.parameters import Model


@pytest.fixture(scope="session")
def model():
    """Table 2 with the default interpretations."""
    return Model()
