from drones import BIN, Drones, drones  # noqa: F401: a fixture
