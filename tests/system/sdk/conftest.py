import pytest

from drones import BIN, Drones


@pytest.fixture
def drones(tmp_path):
    made = []

    def make(count: int, clients: int = 1, *options: str) -> Drones:
        made.append(Drones(tmp_path, count, clients, *options))
        return made[-1]

    yield make
    for each in made:
        each.close()
