import pytest
from empty_root import EmptyRoot


@pytest.fixture(scope="module")
def empty_root(ledger, tmp_path_factory) -> EmptyRoot:
    return EmptyRoot(ledger, tmp_path_factory.mktemp("empty") / "root")
