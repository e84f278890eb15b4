"""What goes wrong in the field, each with the hand that carries out the cure as doctor says it."""
import contextlib
import dataclasses
import json
import os
import pathlib
import re
import shutil
import subprocess
from collections.abc import Callable

from breakages import ORG1, PEER, changed, edited, taken
from walk import END_S, Machines

ORG2 = ORG1.replace("org1", "org2")
# The user of a service, as far as other users' files go.
AS_SERVICE = "setpriv --bounding-set=-dac_override,-dac_read_search --inh-caps=-dac_override,-dac_read_search "
START_NODE = "ledgerline node --dir /var/lib/ledgerline-node/ledger --listen {}:7051"


@dataclasses.dataclass
class Fault:
    problem: str
    host: str
    broken: Callable  # a context, which puts back what the cure leaves
    cure: Callable    # cure(machines, what doctor says)
    name: str
    words: tuple = ()
    user: str = ""
    needs: str = ""   # a program that the host must have


def said_command(host: str, stdin: str | None = None):
    """Types the first command of the cure."""
    def cure(machines: Machines, says: str) -> None:
        command = re.search(r"`([^`]+)`", says).group(1)
        subprocess.run(machines.on(host, command), input=stdin, text=True, check=True, capture_output=True,
                       start_new_session=True, timeout=20)
    return cure


def said_endpoint(machines: Machines, says: str) -> None:
    path = machines.etc("raven") / "agent.toml"
    path.write_text(re.sub(r'endpoint = "https://[^"]*"', f'endpoint = {re.search(chr(34) + "[^" + chr(34) + "]+" + chr(34), says).group()}',
                           path.read_text()))


def rename_in_link(machines: Machines, says: str) -> None:
    assert "same name in both" in says
    path = machines.etc("raven") / "link.toml"
    path.write_text(path.read_text().replace('"tello01"', '"tello1"'))


def in_der(path: pathlib.Path, _: Machines) -> None:
    der = subprocess.run(["openssl", "x509", "-in", path, "-outform", "der"], check=True, capture_output=True).stdout
    path.write_bytes(der)


def locked(path: pathlib.Path, _: Machines) -> None:
    pem = subprocess.run(["openssl", "pkey", "-in", path, "-aes256", "-passout", "pass:secret"], check=True, capture_output=True).stdout
    path.write_bytes(pem)


def of_another_user(path: pathlib.Path, _: Machines) -> None:
    path.chmod(0o600)
    os.chown(path, 65534, 65534)


def of_another_authority(path: pathlib.Path, machines: Machines) -> None:
    run = lambda *command: subprocess.run(command, check=True, capture_output=True, cwd=machines.root)
    run("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout", "o.key", "-out",
        "o.pem", "-days", "9", "-subj", "/CN=ca.org1.ledgerline")
    run("openssl", "x509", "-req", "-in", machines.etc("raven") / "raven.csr", "-CA", "o.pem", "-CAkey", "o.key", "-CAcreateserial",
        "-days", "300", "-out", path)


def authority_first(path: pathlib.Path, machines: Machines) -> None:
    """As an authority's bundle has it, or `cat ca.pem raven.pem`."""
    path.write_text((machines.etc("raven") / "authorities/Org1MSP.pem").read_text() + path.read_text())


def sign_again(machines: Machines, says: str) -> None:
    assert "Org1MSP" in says and "sign the request" in says
    org1 = machines.root / ORG1
    machines.run("tower", f"openssl x509 -req -in raven.csr -CA {org1}/ca/ca.org1.ledgerline-cert.pem -CAkey {org1}/ca/priv_sk "
                 "-CAcreateserial -days 365 -out again.pem")
    machines.run("raven", "scp tower:again.pem /etc/ledgerline; ledgerline init --certificate /etc/ledgerline/again.pem --out /etc/ledgerline")


@contextlib.contextmanager
def read_only_disk(machines: Machines):
    folder = machines.root / "raven/var"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=2g", "tmpfs", folder], check=True)
    try:
        subprocess.run(["mount", "-o", "remount,ro", folder], check=True)
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def old_script_listens(machines: Machines):
    return taken(machines, "AF_INET", "('', 8890)", "ss -lun | grep -q :8890")


@contextlib.contextmanager
def firewall_drops_states(machines: Machines):
    """And nothing else: the drone answers its commands."""
    sim = machines.start("raven", "ledgerline sim --drones 1")
    machines.run("raven", "iptables -A INPUT -p udp --dport 8890 -j DROP")
    try:
        yield
    finally:
        machines.run("raven", "iptables -F INPUT")
        machines.running.remove(sim)
        assert sim.end(END_S) is not None, "it had to be killed"


def server_of(endpoint: str, whose: str) -> str:
    return f'endpoint = "{endpoint}"\ntls_ca = "/etc/ledgerline/tls/{whose}.pem"\nserver_name = "localhost"\n'


@contextlib.contextmanager
def endorser_copied(machines: Machines):
    """The table of Org1's peer, with another organisation's name: on the direct path nobody of Org2 signs."""
    tables = f"[[orderer]]\n{server_of(PEER, 'Org1MSP')}" + "".join(
        f'[[endorser]]\nmsp_id = "{msp_id}"\n{server_of(PEER, "Org1MSP")}' for msp_id in ("Org1MSP", "Org2MSP"))
    tables = tables.replace("/etc/ledgerline", str(machines.etc("raven")))
    with changed("raven", "agent.toml", lambda path, _: path.write_text(path.read_text() + tables))(machines):
        yield


def name_its_own_peer(machines: Machines, says: str) -> None:
    assert "set endpoint and tls_ca of the [[endorser]] of Org2MSP" in says and "Org3MSP" in says, says
    newest = max(machines.root.glob("tower.*.out"), key=lambda said: said.stat().st_mtime)
    ready = json.loads(next(line for line in newest.read_text().splitlines() if '"ready"' in line))
    path = machines.etc("raven") / "agent.toml"
    before, of_org2 = path.read_text().rsplit('msp_id = "Org2MSP"', 1)
    path.write_text(f'{before}msp_id = "Org2MSP"{of_org2.replace(PEER, ready["peers"][1]).replace("tls/Org1MSP", "tls/Org2MSP")}')


@contextlib.contextmanager
def tunnel_in_the_way(machines: Machines):
    """The bridge drops what is longer than its port takes, and says so to nobody."""
    subprocess.run(["ip", "link", "set", "raven", "mtu", "600"], check=True)
    try:
        yield
    finally:
        subprocess.run(["ip", "link", "set", "raven", "mtu", "1500"], check=True)
        machines.run("raven", "ip link set dev eth0 mtu 1500")


def measure_and_lower(machines: Machines, says: str) -> None:
    assert "`ping -M do" in says and "`ip link set dev INTERFACE mtu`" in says
    machines.run("raven", "ip link set dev eth0 mtu 600")


@contextlib.contextmanager
def on_loopback_alone(machines: Machines):
    def start(address: str):
        assert machines.running[0].end(END_S) is not None, "it had to be killed"
        machines.running[0] = machines.start("tower", START_NODE.format(address))
        machines.running.pop()

    start("127.0.0.1")
    machines.repair_node = lambda: start("10.77.0.2")
    try:
        yield
    finally:
        if machines.repair_node:
            machines.repair_node()


def listen_at_its_address(machines: Machines, says: str) -> None:
    assert "at 127.0.0.1 only its own host reaches it" in says
    assert re.search(r"127\.0\.0\.1\]?:7051", machines.run("tower", "ss -ltn"))
    machines.repair_node()
    machines.repair_node = None


def enroll_a_user(machines: Machines, number: int) -> None:
    """Which writes a block the first time."""
    user = f"users/User1@org{number}.ledgerline/msp/signcerts/User1@org{number}.ledgerline-cert.pem"
    certificate = machines.root / {1: ORG1, 2: ORG2}[number] / user
    machines.run("tower", f"ledgerline control --config org{number}/admin.toml enroll --msp Org{number}MSP --cert {certificate} --role operator")


@contextlib.contextmanager
def holder_is_gone(machines: Machines):
    enroll_a_user(machines, 2)
    machines.run("tower", "sed 's/Admin@/User1@/' org2/admin.toml > org2/user1.toml\n"
                 "ledgerline control --config org2/user1.toml acquire tello1")
    yield


def evict(machines: Machines, says: str) -> None:
    assert "`ledgerline control evict NAME`" in says and "supervisor of the drone's organisation" in says
    admin = machines.root / ORG1 / "users/Admin@org1.ledgerline/msp/signcerts/Admin@org1.ledgerline-cert.pem"
    machines.run("tower", f"ledgerline control --config org1/admin.toml enroll --msp Org1MSP --cert {admin} --role supervisor\n"
                 "ledgerline control --config org1/admin.toml evict tello1")


@contextlib.contextmanager
def nobody_tracks(machines: Machines):
    machines.tracks = None
    try:
        yield
    finally:
        if machines.tracks:
            machines.running.remove(machines.tracks)
            assert machines.tracks.end(END_S) is not None, "it had to be killed"


def start_motion_capture(machines: Machines, says: str) -> None:
    assert says.startswith("start motion capture")
    machines.tracks = machines.start("raven", "ledgerline sim --drones 1")


ALL = [
    Fault("not_pem", "raven", changed("raven", "tls/Org1MSP.pem", in_der), said_command("raven"), "der_tls_authority"),
    Fault("not_pem", "raven", changed("raven", "msp/signcerts/cert.pem", in_der), said_command("raven"), "der_certificate"),
    Fault("certificate_order", "raven", changed("raven", "msp/signcerts/cert.pem", authority_first), said_command("raven"),
          "authority_first"),
    Fault("key_locked", "raven", changed("raven", "msp/keystore/priv_sk", locked), said_command("raven", "secret\n"), "locked_key"),
    Fault("file_forbidden", "raven", changed("raven", "msp/keystore/priv_sk", of_another_user), said_command("raven"), "chown_forgotten",
          user=AS_SERVICE),
    Fault("file_forbidden", "raven", changed("raven", "agent.toml", of_another_user), said_command("raven"), "config_of_root",
          user=AS_SERVICE),
    Fault("drones_differ", "raven", edited("raven", "link.toml", 'name = "tello1"', 'name = "tello01"'), rename_in_link, "typo_in_a_drone"),
    Fault("endpoint_wrong", "raven", edited("raven", "agent.toml", PEER, f"https://{PEER}"), said_endpoint, "endpoint_as_url"),
    Fault("disk_read_only", "raven", read_only_disk, said_command("raven"), "read_only_disk"),
    Fault("state_port_taken", "raven", old_script_listens, said_command("raven"), "old_script_listens"),
    Fault("pose_silent", "raven", nobody_tracks, start_motion_capture, "nobody_tracks", words=("--drones",)),
    Fault("state_silent", "raven", firewall_drops_states, said_command("raven"), "states_dropped", words=("--drones",), needs="iptables"),
    Fault("policy_unreachable", "raven", endorser_copied, name_its_own_peer, "endorser_copied"),
    Fault("server_mute", "raven", tunnel_in_the_way, measure_and_lower, "mtu"),
    Fault("port_closed", "raven", on_loopback_alone, listen_at_its_address, "node_on_loopback"),
    Fault("lease_held", "ground", holder_is_gone, evict, "holder_is_gone"),
    Fault("identity_foreign", "raven", changed("raven", "msp/signcerts/cert.pem", of_another_authority), sign_again, "tower_set_up_again"),
]


@contextlib.contextmanager
def two_addresses(machines: Machines):
    """No fault: IPv6 first, where nobody listens; programs go on to the second."""
    hosts = machines.root / "hosts"
    hosts.write_text("127.0.0.1 localhost\nfd00::2 tower.example\n10.77.0.2 tower.example\n")
    subprocess.run(["mount", "--bind", hosts, "/etc/hosts"], check=True)
    try:
        for host, k in (("raven", 1), ("tower", 2)):
            machines.run(host, f"ip addr add fd00::{k}/64 dev eth0 nodad")
        with edited("raven", "agent.toml", PEER, "tower.example:7051")(machines):
            yield
    finally:
        subprocess.run(["umount", "/etc/hosts"], check=True)


@contextlib.contextmanager
def two_keys(machines: Machines):
    """No fault: of two keys the one counts that the certificate is of."""
    other = machines.etc("raven") / "msp/keystore/a_sk"
    shutil.copy(machines.etc("ground") / "msp/keystore/priv_sk", other)
    try:
        yield
    finally:
        other.unlink()
