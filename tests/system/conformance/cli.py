"""Fabric's own command line, `peer`."""
import json
import os
import subprocess

from fabric import FABRIC


class Peer:
    """`peer` as one user; answers as (exit code, standard output, standard error)."""

    def __init__(self, ledger, organisation: int, user: str, msp_id: str | None = None):
        endpoint, ca_file = ledger.peer(organisation)
        self.ordering = ["-o", ledger.orderer()[0], "--tls", "--cafile", str(ledger.orderer()[1])]
        self.environment = {
            **os.environ, "FABRIC_CFG_PATH": str(FABRIC / "config"), "FABRIC_LOGGING_SPEC": "info",
            "CORE_PEER_ADDRESS": endpoint, "CORE_PEER_LOCALMSPID": msp_id or f"Org{organisation}MSP",
            "CORE_PEER_MSPCONFIGPATH": str(ledger.msp_dir(organisation, user)), "CORE_PEER_TLS_ENABLED": "true",
            "CORE_PEER_TLS_ROOTCERT_FILE": str(ca_file)}

    def run(self, *arguments) -> subprocess.CompletedProcess:
        return subprocess.run([FABRIC / "peer", *map(str, arguments)], env=self.environment, capture_output=True,
                              text=True, timeout=60)

    def good(self, *arguments) -> str:
        done = self.run(*arguments)
        assert done.returncode == 0, done.stderr
        return done.stdout + done.stderr

    def query(self, *args: str) -> subprocess.CompletedProcess:
        return self.run("chaincode", "query", *on_contract(*args))

    def invoke(self, *args: str, more=()) -> subprocess.CompletedProcess:
        return self.run("chaincode", "invoke", *self.ordering, *on_contract(*args), *more)


def on_contract(*args: str) -> tuple:
    return "-C", "teleop", "-n", "ledgerline", "-c", json.dumps({"Args": args})
