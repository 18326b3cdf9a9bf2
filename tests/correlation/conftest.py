import pytest
from pictures import Texture


@pytest.fixture(scope="session")
def texture():
    return Texture()
