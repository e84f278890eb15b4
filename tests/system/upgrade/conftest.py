"""Members of a network that somebody else has started, by the conformance tests' official client."""
import json
import os
import pathlib
import sys

import pytest

sys.path.append(str(pathlib.Path(__file__).parents[1] / "conformance"))

from ledgers import Fabric  # noqa: E402
from official import Client, Node, asset  # noqa: E402


class Started(Fabric):
    """Runs in this directory already."""

    def start(self) -> None:
        self.ready = json.loads((self.directory / "network.json").read_text())
        self.endpoint = self.ready["endpoint"]


class Members:
    def __init__(self, directory: pathlib.Path):
        self.ledger = Started(directory)
        self.node = Node(pathlib.Path(os.environ["LEDGERLINE_NPM"]) / "node_modules", self.ledger)

    def __call__(self, organisation: int, user: str) -> Client:
        return self.node.user(organisation, user)

    def forge(self, writes: list, *organisations: int) -> int:
        """A transaction of Org3's User1 that writes whatever it wants, endorsed by these organisations' peers; its flag."""
        answer = self(3, "User1").call("forged", "set", asset("Org3MSP/forged"), how="writes", writes=writes,
                                       peers=[self.ledger.identity(k, "peer0") for k in organisations])
        assert "code" in answer, answer
        return answer["code"]

    def height(self) -> int:
        """How many blocks there are, at least."""
        return self(1, "Admin").ask("seek", service="peer", start="newest", stop="newest")["numbers"][0] + 1

    def close(self) -> None:
        self.node.close()


@pytest.fixture
def members():
    made = []

    def of(directory: pathlib.Path) -> Members:
        made.append(Members(directory))
        return made[-1]

    yield of
    for each in made:
        each.close()
