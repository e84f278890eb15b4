"""Where tests find Fabric's own programs, and what Fabric's peers want of a test's network."""
import os
import pathlib
import socket
import subprocess

import pytest

FABRIC = pathlib.Path(os.environ["LEDGERLINE_FABRIC"])


def needs_fabric() -> None:
    if not (FABRIC / "go.sum").exists():
        pytest.skip("Fabric's programs are missing: scripts/fabric-tools builds them (Go 1.24 or newer)")
    # A peer does not start on a host that has no address but loopback's, though it uses no other.
    if "fabric0" not in (name for _, name in socket.if_nameindex()):
        for command in ("link add fabric0 type veth peer name fabric1", "addr add 192.0.2.1/24 dev fabric0",
                        "link set fabric0 up", "link set fabric1 up"):
            subprocess.run(["ip", *command.split()], check=True)
