"""A network of Fabric with endorsers' certificates."""
import pytest
from fabric import needs_fabric
from ledgers import CUTTING, Fabric


@pytest.fixture
def network(tmp_path):
    needs_fabric()
    ledger = Fabric(tmp_path / "network", *CUTTING)
    yield ledger
    assert ledger.stop() == 0, ledger.log()
