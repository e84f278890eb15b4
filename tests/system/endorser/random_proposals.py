"""Random proposals that an endorser and its peer are asked."""
import json
import pathlib
import subprocess

from endorsers import Endorser
from fabric import BIN, TIMEOUT_S
from ledgers import tables


def configs_of(ledger, directory: pathlib.Path) -> list[pathlib.Path]:
    """The drones' host, administrators, and people of two organisations, as `endorser::Who` has them."""
    files = []
    for organisation, user in ((1, "User1"), (1, "Admin"), (2, "Admin"), (2, "User1"), (2, "User2"), (1, "User2")):
        file = directory / f"{user}{organisation}.toml"
        # Who calls for another organisation's drones is endorsed by its peer.
        file.write_text(tables(ledger, organisation, user, endorsers=True).split("[[msp]]")[0])
        files.append(file)
    return files


def ask_random_proposals(ledger, directory: pathlib.Path, endorser: Endorser, count: int, *options: str) -> dict:
    """What test_random_proposals says of both of them."""
    configs = [word for file in configs_of(ledger, directory) for word in ("--config", file)]
    ca = ledger.organisation(1) / "ca"
    done = subprocess.run([BIN / "test_random_proposals", *configs, "--endorser", endorser.endpoint, "--tls-ca", ledger.ca_file(1),
                           "--ca-key", ca / "priv_sk", "--ca-certificate", ca / "ca.org1.ledgerline-cert.pem",
                           "--count", str(count), *options], capture_output=True, text=True, timeout=TIMEOUT_S * 40)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
