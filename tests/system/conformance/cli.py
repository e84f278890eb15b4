"""Fabric's own command line, `peer`, at either ledger."""
import json
import subprocess

from fabric import Peer
from ledgers import Ledger


def peer_of(ledger: Ledger, organisation: int, user: str, msp_id: str | None = None) -> Peer:
    """As a user of an organisation; `msp_id`: who says to be of another one."""
    (endpoint, ca_file), (orderer, orderer_ca_file) = ledger.peer(organisation), ledger.orderer()
    peer = Peer(ledger.directory, endpoint, organisation, orderer, user, ca_files=(ca_file, orderer_ca_file))
    peer.environment["FABRIC_LOGGING_SPEC"] = "info"  # what it says of a transaction
    peer.environment["CORE_PEER_LOCALMSPID"] = msp_id or f"Org{organisation}MSP"
    # Two organisations endorse: its own, and one of the others.
    peer.endorsers = [word for k in (organisation, 1 if organisation != 1 else 2)
                      for word in ("--peerAddresses", ledger.endorser(k)[0], "--tlsRootCertFiles", ledger.endorser(k)[1])]
    return peer


def good(peer: Peer, *words) -> str:
    done = peer.run(*words)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def query(peer: Peer, *args: str, contract: str = "ledgerline") -> subprocess.CompletedProcess:
    return peer.run("chaincode", "query", *on_contract(*args, contract=contract))


def invoke(peer: Peer, *args: str, more=()) -> subprocess.CompletedProcess:
    return peer.run("chaincode", "invoke", *peer.ordering, *peer.endorsers, *on_contract(*args), *more)


def on_contract(*args: str, contract: str = "ledgerline") -> tuple:
    return "-C", "teleop", "-n", contract, "-c", json.dumps({"Args": args})
