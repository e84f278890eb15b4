import pytest

from drones import drones  # noqa: F401: a fixture
from proxies import Proxy


@pytest.fixture
def proxies(tmp_path):
    made = []

    def make(**options) -> Proxy:
        directory = tmp_path / f"proxy{len(made)}"
        directory.mkdir()
        made.append(Proxy(directory, **options))
        return made[-1]

    yield make
    for each in made:
        each.close()
