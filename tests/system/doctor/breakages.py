"""One thing broken at a time, and repaired: each is a context."""
import contextlib
import dataclasses
import hashlib
import pathlib
import re
import shutil
import socket
import subprocess
from collections.abc import Callable

from walk import Machines

ORG1 = "tower/var/ledger/crypto/peerOrganizations/org1.ledgerline"


@dataclasses.dataclass
class Breakage:
    problem: str
    host: str
    broken: Callable
    words: tuple = ()


@contextlib.contextmanager
def kept(path: pathlib.Path):
    """A file that may be changed or removed meanwhile. Of hidden files in a keystore programs take none."""
    copy = path.with_name(f".{path.name}.kept")
    shutil.copy2(path, copy)
    try:
        yield path
    finally:
        shutil.move(copy, path)


def edited(host: str, file: str, old: str, new: str):
    @contextlib.contextmanager
    def broken(machines: Machines):
        with kept(machines.etc(host) / file) as path:
            text = path.read_text()
            assert old in text, f"{file} has no {old}"
            path.write_text(text.replace(old, new))
            yield
    return broken


def changed(host: str, file: str, change):
    """change(path, machines) breaks the file."""
    @contextlib.contextmanager
    def broken(machines: Machines):
        with kept(machines.etc(host) / file) as path:
            change(path, machines)
            yield
    return broken


def signed(days: int):
    def change(path: pathlib.Path, machines: Machines) -> None:
        org1 = machines.root / ORG1
        subprocess.run(["openssl", "x509", "-req", "-in", machines.etc("raven") / "raven.csr", "-CA",
                        org1 / "ca/ca.org1.ledgerline-cert.pem", "-CAkey", org1 / "ca/priv_sk", "-CAcreateserial", "-days",
                        str(days), "-out", path], check=True, capture_output=True)
    return change


def copy_of(source: str):
    return lambda path, machines: shutil.copy(machines.root / source, path)


def of_another_chain(path: pathlib.Path, _: Machines) -> None:
    """Its checkpoint is of a block that the ledger will not have for long."""
    text = path.read_text()
    folder = re.search(r'msp_dir = "(.+)/msp"', text).group(1)
    checkpoint = f"ledgerline checkpoint 1\nchannel teleop\nblock 1000000\nhash {'00' * 32}\nrecords 0\n"
    (path.parent / "later.checkpoint").write_text(f"{checkpoint}\nsum {hashlib.sha256(checkpoint.encode()).hexdigest()}\n")
    text, count = re.subn(r'(?m)^checkpoint = ".*"', f'checkpoint = "{folder}/later.checkpoint"', text)
    assert count == 1, text
    path.write_text(text)


def away(name: str):
    @contextlib.contextmanager
    def broken(machines: Machines):
        there, elsewhere = machines.root / name, machines.root / "away"
        there.rename(elsewhere)
        try:
            yield
        finally:
            elsewhere.rename(there)
    return broken


def said_on_ledger(commands: str, back: str):
    """By the administrators at tower."""
    @contextlib.contextmanager
    def broken(machines: Machines):
        machines.run("tower", commands)
        try:
            yield
        finally:
            machines.run("tower", back)
    return broken


@contextlib.contextmanager
def taken(machines: Machines, family: str, address: str, seen: str):
    """An outsider on raven has that datagram socket; `seen`: a command that ends with 0 once he has."""
    code = f"import socket, time; s = socket.socket(socket.{family}, socket.SOCK_DGRAM); s.bind({address}); time.sleep(60)"
    outsider = machines.spaces["raven"].popen("python3", "-c", code)
    try:
        machines.run("raven", f"until {seen}; do sleep 0.1; done")
        yield
    finally:
        outsider.kill()
        outsider.wait()


@contextlib.contextmanager
def outsider_as_roudi(machines: Machines):
    try:
        with taken(machines, "AF_UNIX", "'/tmp/roudi'", "test -S /tmp/roudi"):
            yield
    finally:
        pathlib.Path("/tmp/roudi").unlink()


@contextlib.contextmanager
def left_by_roudi(_: Machines):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as gone:
        gone.bind("/tmp/roudi")
    try:
        yield
    finally:
        pathlib.Path("/tmp/roudi").unlink()


@contextlib.contextmanager
def small_disk(machines: Machines):
    folder = machines.root / "raven/var"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


@contextlib.contextmanager
def dds_over_what_is_down(machines: Machines):
    machines.run("raven", "ip link add spare type veth peer name spare1")
    try:
        with edited("raven", "agent.toml", "local_only = true", 'interfaces = ["spare"]')(machines):
            yield
    finally:
        machines.run("raven", "ip link del spare")


@contextlib.contextmanager
def small_memory(_: Machines):
    subprocess.run(["mount", "-o", "remount,size=32m", "/dev/shm"], check=True)
    try:
        yield
    finally:
        subprocess.run(["mount", "-o", "remount,size=512m", "/dev/shm"], check=True)


def served(*words: str, certificate_days: int = 10):
    """An outsider's server at raven's port 7059, of the ledger's TLS authority."""
    @contextlib.contextmanager
    def broken(machines: Machines):
        org1, folder = machines.root / ORG1, machines.root
        run = lambda *command: subprocess.run(command, check=True, capture_output=True)
        run("openssl", "req", "-new", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-keyout",
            folder / "s.key", "-subj", "/CN=s", "-out", folder / "s.csr")
        (folder / "s.ext").write_text("subjectAltName=DNS:localhost\n")
        run("openssl", "x509", "-req", "-in", folder / "s.csr", "-CA", org1 / "tlsca/tlsca.org1.ledgerline-cert.pem", "-CAkey",
            org1 / "tlsca/priv_sk", "-CAcreateserial", "-days", str(certificate_days), "-extfile", folder / "s.ext", "-out",
            folder / "s.pem")
        server = machines.spaces["raven"].popen("openssl", "s_server", "-accept", "7059", "-alpn", "h2", "-quiet", "-cert",
                                                folder / "s.pem", "-key", folder / "s.key", *words,
                                                stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            machines.run("raven", "until ss -ltn | grep -q :7059; do sleep 0.1; done")
            with edited("raven", "agent.toml", PEER, "127.0.0.1:7059")(machines):
                yield
        finally:
            server.kill()
            server.wait()
    return broken


PEER = "10.77.0.2:7051"
INTERFACE = '\naddress = "127.0.0.2"\ninterface = "{}"'
INTERFACED = '\naddress = "127.0.0.2"'
ENROLL = "ledgerline control --config org1/admin.toml enroll --msp Org1MSP --cert {} tello1"
USER1 = f"../../{ORG1}/users/User1@org1.ledgerline/msp/signcerts/User1@org1.ledgerline-cert.pem"

ALL = [
    Breakage("config_missing", "raven", away("raven/etc/agent.toml"), ("--role", "drone-host")),
    Breakage("config_wrong", "raven", edited("raven", "link.toml", "[limits]", "[limits]\nspeed = 1")),
    Breakage("state_folder", "raven", away("raven/var")),
    Breakage("certificate_missing", "raven", away("raven/etc/msp/signcerts/cert.pem")),
    Breakage("certificate_wrong", "raven", changed("raven", "msp/signcerts/cert.pem", lambda path, _: path.write_text("x"))),
    Breakage("key_missing", "raven", away("raven/etc/msp/keystore/priv_sk")),
    Breakage("key_open", "raven", changed("raven", "msp/keystore/priv_sk", lambda path, _: path.chmod(0o644))),
    Breakage("key_misfit", "raven", changed("raven", "msp/signcerts/cert.pem", copy_of("tower/home/ground.pem"))),
    Breakage("identity_expired", "raven", changed("raven", "msp/signcerts/cert.pem", signed(-1))),
    Breakage("identity_ends", "raven", changed("raven", "msp/signcerts/cert.pem", signed(10))),
    Breakage("identity_foreign", "raven", edited("raven", "agent.toml", 'msp_id = "Org1MSP"', 'msp_id = "Org2MSP"')),
    Breakage("anchor_missing", "raven", edited("raven", "agent.toml", "config_block =", "# config_block =")),
    Breakage("anchor_wrong", "raven", edited("raven", "agent.toml", 'channel = "teleop"', 'channel = "other"')),
    Breakage("authority_unreadable", "raven", away("raven/etc/authorities/Org3MSP.pem")),
    Breakage("authority_foreign", "ground", changed("ground", "authorities/Org1MSP.pem", copy_of("ground/etc/authorities/Org2MSP.pem"))),
    Breakage("checkpoint_refused", "raven", changed("raven", "agent.toml", of_another_chain)),
    Breakage("name_unknown", "raven", edited("raven", "agent.toml", PEER, "tower.invalid:7051")),
    Breakage("no_route", "raven", edited("raven", "agent.toml", PEER, "203.0.113.1:7051")),
    Breakage("port_closed", "raven", edited("raven", "agent.toml", PEER, "10.77.0.2:7050")),
    Breakage("tls_ca_unreadable", "raven", away("raven/etc/tls/Org1MSP.pem")),
    Breakage("tls_wrong_authority", "raven", changed("raven", "tls/Org1MSP.pem", copy_of("raven/etc/authorities/Org1MSP.pem"))),
    Breakage("tls_wrong_name", "ground", edited("ground", "ground.toml", 'server_name = "localhost"', 'server_name = "tower"')),
    Breakage("tls_expired", "raven", served(certificate_days=-1)),
    Breakage("tls_client_certificate", "raven", served("-Verify", "1")),
    Breakage("not_enrolled", "raven", edited("raven", "agent.toml", 'name = "tello1"', 'name = "nobody"')),
    Breakage("of_another_host", "raven", said_on_ledger(ENROLL.format(USER1), ENROLL.format("raven.pem"))),
    Breakage("may_not_fly", "ground", said_on_ledger(
        "ledgerline control --config org2/admin.toml revoke --msp Org2MSP --cert ground.pem",
        "ledgerline control --config org2/admin.toml enroll --msp Org2MSP --cert ground.pem --role operator")),
    Breakage("roudi_left", "raven", left_by_roudi),
    Breakage("roudi_foreign", "raven", outsider_as_roudi),
    Breakage("shm_small", "raven", small_memory),
    Breakage("interface_missing", "raven", edited("raven", "link.toml", INTERFACED, INTERFACE.format("wlan9"))),
    Breakage("interface_missing", "raven", edited("raven", "agent.toml", "local_only = true", 'interfaces = ["wlan9"]')),
    Breakage("interface_down", "raven", dds_over_what_is_down),
    Breakage("disk_full", "raven", small_disk),
    Breakage("wrong_interface", "raven", edited("raven", "link.toml", INTERFACED, INTERFACE.format("eth0"))),
]
