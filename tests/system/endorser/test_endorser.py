"""An organisation's own endorser beside its peer: the same answers, and flights that outlive it."""
import json
import os
import pathlib
import signal
import subprocess
import time

import pytest
from fabric import BIN, PATIENCE_S, needs_fabric, processes_in
from flights import fly, no_flight_outlives_its_test, printed, result, wait_for_flight
from ledgers import CUTTING, Fabric, tables
from netns import die_with_parent

COUNT = 10_000 if os.environ.get("LEDGERLINE_LONG") == "1" else 500


class Endorser:
    """`ledgerline endorser` of Org1, as it is ready."""

    def __init__(self, ledger, directory: pathlib.Path, more: str = ""):
        own = ledger.organisation(1) / "peers" / "endorser0.org1.ledgerline"
        endpoint, ca_file = ledger.peer(1)
        self.summary_file = directory / "endorser.json"
        self.log_file = directory / "endorser.log"
        config = directory / "endorser.toml"
        config.write_text(f'[ledger]\nendpoint = "{endpoint}"\ntls_ca = "{ca_file}"\nmsp_id = "Org1MSP"\nmsp_dir = "{own}/msp"\n'
                          f'config_block = "{ledger.directory}/teleop.block"\n[serve]\ntls_certificate = "{own}/tls/server.crt"\n'
                          f'tls_key = "{own}/tls/server.key"\n{more}[output]\nsummary = "{self.summary_file}"\n')
        self.process = subprocess.Popen([BIN / "ledgerline-endorser", config], stdout=subprocess.PIPE,
                                        stderr=open(self.log_file, "ab"), text=True, preexec_fn=die_with_parent)
        ready = self.process.stdout.readline()
        assert ready, self.log_file.read_text()
        self.endpoint = json.loads(ready)["endpoint"]

    def stop(self) -> dict:
        self.process.terminate()
        assert self.process.wait(timeout=PATIENCE_S) == 0, self.log_file.read_text()
        return json.loads(self.summary_file.read_text())


@pytest.fixture
def network(tmp_path):
    needs_fabric()
    ledger = Fabric(tmp_path / "network", *CUTTING)
    yield ledger
    assert ledger.stop() == 0, ledger.log()


def configs_of(ledger, directory: pathlib.Path) -> list[pathlib.Path]:
    """The drones' host, administrators, and people of two organisations."""
    files = []
    for organisation, user in ((1, "User1"), (1, "Admin"), (2, "Admin"), (2, "User1"), (2, "User2")):
        file = directory / f"{user}{organisation}.toml"
        # Who calls for another organisation's drones is endorsed by its peer.
        file.write_text(tables(ledger, organisation, user, endorsers=True).split("[[msp]]")[0])
        files.append(file)
    return files


def test_random_proposals_are_answered_byte_for_byte_as_by_the_peer(network, tmp_path):
    endorser = Endorser(network, tmp_path, "check_one_in = 10\n")
    configs = [word for file in configs_of(network, tmp_path) for word in ("--config", file)]
    done = subprocess.run([BIN / "test_random_proposals", *configs, "--endorser", endorser.endpoint, "--tls-ca", network.ca_file(1),
                           "--count", str(COUNT)], capture_output=True, text=True, timeout=PATIENCE_S * 20)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)
    print(json.dumps(said, indent=1))
    assert said["differ"] == 0, said["first_difference"]
    assert said["committed"] > COUNT / 50 and said["invalid"] == 0
    assert sum(said["refusals"].values()) > COUNT / 20 and len(said["same"]) > 12
    counts = endorser.stop()
    assert counts["differ"] == 0 and counts["same"] > 0, counts
    # It starts again from nothing but the chain.
    again = Endorser(network, tmp_path)
    assert again.stop()["blocks"] == counts["blocks"]


def test_a_flight_goes_on_over_the_peer_when_its_endorser_is_killed(tmp_path):
    needs_fabric()
    flight = fly(tmp_path, "--drones", "1", "--seconds", "8", "--ledger", "fabric", "--endorser")
    wait_for_flight(tmp_path, flight)
    time.sleep(2)
    children = pathlib.Path(f"/proc/{flight.pid}/task/{flight.pid}/children").read_text().split()
    mine = [int(pid) for pid in children if b"ledgerline-endorser" in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes()]
    assert len(mine) == 1
    os.kill(mine[0], signal.SIGKILL)
    flight.wait(120)
    assert "the peer endorses in its place" in printed(tmp_path), printed(tmp_path)
    agent = json.loads((tmp_path / "run" / "agent.summary.json").read_text())
    print({key: value for key, value in agent.items() if isinstance(value, (int, float))})
    assert agent["doubts"] == 0
