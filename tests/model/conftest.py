import pytest

from labkit.model.parameters import Model


@pytest.fixture(scope="session")
def model():
    """Table 2 with the default interpretations."""
    return Model()


@pytest.fixture(scope="session")
def flat():
    """Table 2, continued beyond e_cmax."""
    return Model().reading(beyond_e_cmax="flat")
