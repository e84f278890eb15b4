"""Our validator of transactions beside a real peer: good and spoilt ones in many ways, and the network's own from block 0 on."""
import json
import os
import subprocess

from fabric import BIN, TIMEOUT_S, needs_fabric
from ledgers import CUTTING, Fabric

COUNT = 10_000 if os.environ.get("LEDGERLINE_LONG") == "1" else 600
SPOILT = 30  # kinds, at least, that a peer flags invalid each time


def test_validator_and_peer_say_the_same_of_every_transaction(tmp_path):
    needs_fabric()
    ledger = Fabric(tmp_path / "network", *CUTTING)
    try:
        endpoint, ca_file = ledger.peer(1)
        config = tmp_path / "member.toml"
        config.write_text(f"""[ledger]
endpoint = "{endpoint}"
tls_ca = "{ca_file}"
msp_id = "Org1MSP"
msp_dir = "{ledger.msp_dir(1, "User1")}"
""")
        orderer, orderer_ca = ledger.orderer()
        done = subprocess.run([BIN / "test_validation_campaign", "--config", config, "--crypto", ledger.directory / "crypto",
                               "--orderer", orderer, "--orderer-ca", orderer_ca, "--count", str(COUNT)],
                              capture_output=True, text=True, timeout=TIMEOUT_S * 10)
        peer_log = (ledger.directory / "logs" / "peer1.log").read_text()
        assert done.returncode == 0, done.stderr + peer_log[-3000:]
    finally:
        assert ledger.stop() == 0, ledger.log()
    said = json.loads(done.stdout)
    print(json.dumps({key: value for key, value in said.items() if key != "differ"}, indent=1))
    assert said["differ"] == [], json.dumps(said["differ"])
    assert said["ours"] == COUNT
    never_valid = [kind for kind, flags in said["kinds"].items() if "0" not in flags]
    assert len(never_valid) >= SPOILT, never_valid
    valid = sum(flags.get("0", 0) for flags in said["kinds"].values())
    assert valid > COUNT / 10  # else everything is refused for one reason
