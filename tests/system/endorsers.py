"""An organisation's own endorser, beside either ledger."""
import json
import pathlib
import subprocess

from fabric import BIN, TIMEOUT_S
from netns import die_with_parent


def write_config(ledger, directory: pathlib.Path, more: str = "", pair: tuple[pathlib.Path, pathlib.Path] | None = None) -> pathlib.Path:
    """`more`: behind [serve]'s own keys, with tables of its own if it has some. `pair`: a certificate of TLS and its key, where the ledger asks
    its clients for one."""
    own = ledger.organisation(1) / "peers" / "endorser0.org1.ledgerline"
    endpoint, ca_file = ledger.peer(1)
    directory.mkdir(exist_ok=True)
    config = directory / "endorser.toml"
    shown = f'tls_certificate = "{pair[0]}"\ntls_key = "{pair[1]}"\n' if pair else ""
    config.write_text(f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca_file}"\n{shown}msp_id = "Org1MSP"\nmsp_dir = "{own}/msp"\n'
                      f'config_block = "{ledger.directory}/teleop.block"\n[serve]\ntls_certificate = "{own}/tls/server.crt"\n'
                      f'tls_key = "{own}/tls/server.key"\n{more}[output]\nsummary = "{directory}/endorser.json"\n')
    return config


class Endorser:
    """`ledgerline endorser` of Org1, as it is ready; its options as write_config has them."""

    def __init__(self, ledger, directory: pathlib.Path, *options):
        config = write_config(ledger, directory, *options)
        self.summary_file = directory / "endorser.json"
        self.log_file = directory / "endorser.log"
        self.process = subprocess.Popen([BIN / "ledgerline-endorser", config], stdout=subprocess.PIPE,
                                        stderr=open(self.log_file, "ab"), text=True, preexec_fn=die_with_parent)
        ready = self.process.stdout.readline()
        assert ready, self.log_file.read_text()
        self.endpoint = json.loads(ready)["endpoint"]

    def stop(self) -> dict:
        self.process.terminate()
        assert self.process.wait(timeout=TIMEOUT_S) == 0, self.log_file.read_text()
        return json.loads(self.summary_file.read_text())
