"""One organisation's peer that is not there, or says nothing, is said; calls go on without it, a moment later."""
import socket
import subprocess

import pytest
from fabric import BIN
from ledgers import tables


@pytest.fixture
def absent():
    """Where nobody listens."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        yield "127.0.0.1:{}".format(taken.getsockname()[1])


@pytest.fixture
def mute():
    """Where connections are taken, and never answered."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield "127.0.0.1:{}".format(taken.getsockname()[1])


@pytest.mark.parametrize("kind", ["absent", "mute"])
def test_acquire_hand_over_and_stop_go_on_without_the_third_organisations_peer(tmp_path, ledger, enroll, node, request, kind):
    drone = f"without_{kind}"
    enroll(drone)
    pilot = enroll(organisation=2, user="User2", role="OPERATOR")
    text = tables(ledger, 2).split("[[orderer]]")[0].split("[[msp]]")[0]
    text += '[[orderer]]\nendpoint = "{}"\ntls_ca = "{}"\n'.format(*ledger.orderer())
    for k in (1, 2, 3):
        endpoint, ca_file = ledger.endorser(k)
        text += f'[[endorser]]\nmsp_id = "Org{k}MSP"\nendpoint = "{endpoint if k != 3 else request.getfixturevalue(kind)}"\n'
        text += f'tls_ca = "{ca_file}"\n'
    config = tmp_path / "operator.toml"
    config.write_text(text)

    def goes_on(*words) -> None:
        done = subprocess.run([BIN / "ledgerline", "control", "--config", config, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        said = [line for line in done.stderr.splitlines() if "endorsed by less than all" in line]
        assert len(said) == 1 and "Org3MSP" in said[0], done.stderr

    goes_on("acquire", drone)
    pilot.submit("request", {"drones": [drone], "priority": 1})
    certificate = next((ledger.msp_dir(2, "User2") / "signcerts").iterdir())
    goes_on("hand_over", "--msp", "Org2MSP", "--cert", certificate, drone)
    goes_on("stop", drone)
