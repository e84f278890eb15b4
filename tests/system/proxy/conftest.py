import pytest

from drones import Drones
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


@pytest.fixture
def drones(tmp_path):
    made = []

    def make(count: int, clients: int = 1, *options: str) -> Drones:
        made.append(Drones(tmp_path, count, clients, *options))
        return made[-1]

    yield make
    for each in made:
        each.close()
