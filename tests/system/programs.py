"""The example client as a test's client: any identity, either ledger."""
import os
import pathlib
import subprocess

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])


def organisation(directory: pathlib.Path, number: int) -> pathlib.Path:
    return directory / "crypto" / "peerOrganizations" / f"org{number}.ledgerline"


def user_msp(directory: pathlib.Path, number: int, user: str) -> pathlib.Path:
    return organisation(directory, number) / "users" / f"{user}@org{number}.ledgerline" / "msp"


def ask(endpoint: str, directory: pathlib.Path, number: int, msp: pathlib.Path, *words: str,
        program: pathlib.Path = BIN / "client_example", channel: str = "teleop") -> subprocess.CompletedProcess:
    ca = organisation(directory, 1) / "tlsca" / "tlsca.org1.ledgerline-cert.pem"
    return subprocess.run([program, endpoint, ca, f"Org{number}MSP", msp, *words], capture_output=True, text=True,
                          timeout=60, env={**os.environ, "LEDGER_CHANNEL": channel})
