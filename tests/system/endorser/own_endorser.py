"""`ledgerline endorser` of a network's first organisation, and random proposals that it and its peer are asked."""
import json
import pathlib
import subprocess

from fabric import BIN, PATIENCE_S
from ledgers import tables
from netns import die_with_parent


def write_config(ledger, directory: pathlib.Path, more: str = "") -> pathlib.Path:
    """`more`: behind [serve]'s own keys, with tables of its own if it has some."""
    own = ledger.organisation(1) / "peers" / "endorser0.org1.ledgerline"
    endpoint, ca_file = ledger.peer(1)
    directory.mkdir(exist_ok=True)
    config = directory / "endorser.toml"
    config.write_text(f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca_file}"\nmsp_id = "Org1MSP"\nmsp_dir = "{own}/msp"\n'
                      f'config_block = "{ledger.directory}/teleop.block"\n[serve]\ntls_certificate = "{own}/tls/server.crt"\n'
                      f'tls_key = "{own}/tls/server.key"\n{more}[output]\nsummary = "{directory}/endorser.json"\n')
    return config


class Endorser:
    """`ledgerline endorser` of Org1, as it is ready."""

    def __init__(self, ledger, directory: pathlib.Path, more: str = ""):
        config = write_config(ledger, directory, more)
        self.summary_file = directory / "endorser.json"
        self.log_file = directory / "endorser.log"
        self.process = subprocess.Popen([BIN / "ledgerline-endorser", config], stdout=subprocess.PIPE,
                                        stderr=open(self.log_file, "ab"), text=True, preexec_fn=die_with_parent)
        ready = self.process.stdout.readline()
        assert ready, self.log_file.read_text()
        self.endpoint = json.loads(ready)["endpoint"]

    def stop(self) -> dict:
        self.process.terminate()
        assert self.process.wait(timeout=PATIENCE_S) == 0, self.log_file.read_text()
        return json.loads(self.summary_file.read_text())


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
                           "--count", str(count), *options], capture_output=True, text=True, timeout=PATIENCE_S * 40)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
