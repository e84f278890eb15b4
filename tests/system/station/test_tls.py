"""The station with TLS, on an address that other computers reach: as docs/station.md says it is made."""
import http.client
import os
import pathlib
import random
import re
import signal
import socket
import ssl
import subprocess
import time
import urllib.error
import urllib.request

import pytest
from commands import Person
from flights import BIN, fly, no_flight_outlives_its_test, pid_of, printed
from station import TIMEOUT_S, Station, client_hello, spoilt, take_off, velocity
from test_station import end, resident_kb

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
HERE = "192.0.2.10"  # as in the documentation
NAME = "ground.example.org"
DOCS = pathlib.Path(__file__).parents[3] / "docs" / "station.md"


@pytest.fixture
def address():
    """One of this host that is no loopback address."""
    subprocess.run(["ip", "address", "add", f"{HERE}/32", "dev", "lo"], check=True)
    yield HERE
    subprocess.run(["ip", "address", "delete", f"{HERE}/32", "dev", "lo"], check=True)


def make(folder: pathlib.Path, sans: str = "") -> pathlib.Path:
    """By the commands of the documentation: page-ca.pem, page.pem and page.key, alice.pem and alice.key."""
    folder.mkdir()
    blocks = re.findall(r"```sh\n(openssl.*?)```", DOCS.read_text(), re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        block = re.sub(r"subjectAltName=[^\"]+", f"subjectAltName={sans}", block) if sans else block
        subprocess.run(["sh", "-euc", block], check=True, cwd=folder, capture_output=True, timeout=60)
    return folder


class SecureStation(Station):
    """As a program has it that trusts the authority, and may show a certificate."""

    def __init__(self, out: pathlib.Path, made: pathlib.Path, own: str = "") -> None:
        self.url, self.place, self.token = re.findall(r"The page: (https://([\w.:]+))/#token=(\w+)", printed(out))[-1]
        self.authority = made / "page-ca.pem"
        self.context = ssl.create_default_context(cafile=self.authority)
        if own:
            self.context.load_cert_chain(made / f"{own}.pem", made / f"{own}.key")

    def stream(self, **options):
        """By TLS 1.2. With 1.3 a server writes tickets behind its handshake: the client's two threads read them and write the
        request at once, on a socket that Python 3.11 does not lock, and of a thousand requests one or two never went out."""
        context = ssl.create_default_context(cafile=self.authority)
        context.maximum_version = ssl.TLSVersion.TLSv1_2
        return super().stream(**({"ssl": context} | options))

    def reported(self, words: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not any(words in event["text"] for event in self.ask("GET", "events")[1]["events"]):
            assert time.monotonic() < deadline, words
            time.sleep(0.1)


def restart(out: pathlib.Path, change) -> None:
    """Ground, with another config: its launcher starts it again."""
    config = out / "run" / "ground.toml"
    config.write_text(change(config.read_text()))
    shown = printed(out).count("The page: ")
    os.kill(pid_of("ledgerline-ground"), signal.SIGKILL)
    deadline = time.monotonic() + TIMEOUT_S
    while printed(out).count("The page: ") == shown:
        assert time.monotonic() < deadline, printed(out)
        time.sleep(0.05)


def tls_table(made: pathlib.Path, place: str, more: str = "") -> str:
    return (f'[service]\nlisten = "{place}"\nnames = ["{HERE}", "{NAME}"]\ntls_certificate = "{made}/page.pem"\n'
            f'tls_key = "{made}/page.key"\n{more}')


def renew(made: pathlib.Path, new: pathlib.Path) -> None:
    for file in ("page.pem", "page.key"):
        (new / file).replace(made / file)


def test_a_flight_by_https_from_another_address(tmp_path, address):
    flight = fly(tmp_path, "--shape", "manual", "--watch")
    plain = Station(tmp_path, flight)
    plain.wait("tello1", lambda drone: drone["link_phase"] == "on_ground")
    port = plain.place.split(":")[1]
    made, other = make(tmp_path / "made"), make(tmp_path / "other")
    config = (tmp_path / "run" / "ground.toml").read_text()

    # Without TLS not even the config is taken.
    (tmp_path / "open.toml").write_text(re.sub(r'listen = ".*"', f'listen = "{HERE}:{port}"', config))
    refused = subprocess.run([BIN / "ledgerline-ground", "--config", tmp_path / "open.toml"], capture_output=True, text=True, timeout=30)
    assert refused.returncode == 2 and "set tls_certificate and tls_key" in refused.stderr, refused.stderr

    restart(tmp_path, lambda text: re.sub(r'\[service\]\nlisten = ".*"\n', tls_table(made, f"{HERE}:{port}"), text))
    station = SecureStation(tmp_path, made)
    assert station.url == f"https://{HERE}:{port}"
    with urllib.request.urlopen(station.url, timeout=TIMEOUT_S, context=station.context) as page:
        assert page.headers["Strict-Transport-Security"] == "max-age=2592000" and b"<html" in page.read()
    assert station.ask("GET", "drones", headers={"Host": f"{NAME}:{port}"})[0] == 200
    for wrong in ({"Host": f"evil.example:{port}"}, {"Origin": f"http://{HERE}:{port}"}):
        assert station.ask("POST", "stop", headers=wrong)[0] == 403
    for context in (ssl.create_default_context(), ssl.create_default_context(cafile=other / "page-ca.pem")):
        with pytest.raises(urllib.error.URLError, match="CERTIFICATE_VERIFY_FAILED"):
            urllib.request.urlopen(station.url, timeout=TIMEOUT_S, context=context)
    with pytest.raises((OSError, http.client.HTTPException)):
        urllib.request.urlopen(f"http://{HERE}:{port}", timeout=TIMEOUT_S)
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", int(port)), timeout=TIMEOUT_S)

    # The command line: the right authority, another one, none.
    person = Person(tmp_path / "home", station, tmp_path)
    assert "its certificate is not trusted" in person.refused("drones")
    assert "its certificate is not trusted" in person.refused("drones", "--ca", other / "page-ca.pem")
    assert "must be this computer" in person.misused("drones", "--url", f"http://{HERE}:{port}")
    person.environment["LEDGERLINE_CA"] = str(made / "page-ca.pem")
    assert "tello1" in person.says("drones") and "tello1" in person.says("drones", "--ca", made / "page-ca.pem")
    assert "Nothing is in the air" in person.run("flights", "--config", tmp_path / "run" / "ground.toml", LEDGERLINE_CA="").stdout

    # It flies by wss, while the certificate is renewed, and a stop of the command line lands it.
    take_off(station, "tello1")
    before = station.drone("tello1")["position"]
    with station.stream() as stream:
        deadline = time.monotonic() + TIMEOUT_S
        while station.drone("tello1")["position"][0] - before[0] < 0.2:
            assert time.monotonic() < deadline, "it does not fly"
            stream.send(velocity("tello1", 0.4))
            time.sleep(0.03)
        renew(made, make(tmp_path / "bad", f"DNS:{NAME}"))  # of an authority that nobody here trusts
        deadline = time.monotonic() + TIMEOUT_S
        while "new TLS certificate" not in stream.recv(timeout=TIMEOUT_S):
            assert time.monotonic() < deadline
    assert "not trusted" in person.refused("drones")
    for file in ("page-ca.pem", "page-ca.key"):
        (made / file).write_bytes((tmp_path / "bad" / file).read_bytes())
    assert "mismatch" in person.refused("drones"), "the certificate has the name, not the address"
    renew(made, other)
    (made / "page-ca.pem").write_bytes((other / "page-ca.pem").read_bytes())
    station = SecureStation(tmp_path, made)
    deadline = time.monotonic() + TIMEOUT_S
    while person.run("drones", "stop", "--all", expect=None).returncode != 0:
        assert time.monotonic() < deadline, "the right certificate is not taken"
        time.sleep(0.2)
    station.wait("tello1", lambda drone: drone["stopped_by"] and drone["phase"] == "landed")
    (made / "page.key").write_text("nothing")
    station.reported(f"keeps its old TLS certificate: {made}/page.key")
    assert station.ask("GET", "drones")[0] == 200
    end(flight, tmp_path)


def test_hostile_sockets_move_nothing_and_none_gets_in_without_a_certificate(tmp_path, address):
    flight = fly(tmp_path, "--shape", "manual", "--watch")
    plain = Station(tmp_path, flight)
    plain.wait("tello1", lambda drone: drone["link_phase"] == "on_ground")
    port = int(plain.place.split(":")[1])
    made = make(tmp_path / "made")
    table = tls_table(made, f"0.0.0.0:{port}", f'tls_client_ca = "{made}/page-ca.pem"\n')
    restart(tmp_path, lambda text: re.sub(r'\[service\]\nlisten = ".*"\n', table, text))
    station, outsider = SecureStation(tmp_path, made, "alice"), SecureStation(tmp_path, made)
    assert station.ask("GET", "drones")[0] == 200
    with pytest.raises(OSError):
        outsider.ask("POST", "drones/tello1/takeoff")
    person = Person(tmp_path / "home", station, tmp_path)
    person.environment["LEDGERLINE_CA"] = str(made / "page-ca.pem")
    assert "is not reached" in person.refused("drones", "takeoff", "tello1")
    assert "tello1" in person.says("drones", "--certificate", made / "alice.pem", "--key", made / "alice.key")
    (made / "alice.key").chmod(0o644)
    assert "chmod 600" in person.refused("drones", "--certificate", made / "alice.pem", "--key", made / "alice.key")

    if LONG:  # nobody else comes meanwhile, so that time alone ends it
        with socket.create_connection((HERE, port), timeout=TIMEOUT_S) as half:
            half.sendall(client_hello(NAME)[:100])
            begin = time.monotonic()
            assert half.recv(1) == b"" and 9 < time.monotonic() - begin < 20

    draw = random.Random(2)
    hello = client_hello(NAME)
    takeoff = f"POST /api/v1/drones/tello1/takeoff HTTP/1.1\r\nHost: {station.place}\r\nAuthorization: Bearer {station.token}\r\nContent-Length: 2\r\n\r\n"
    held, heard = [], []

    def garbage(wire: socket.socket) -> None:
        wire.sendall(draw.randbytes(draw.randint(1, 2000)))

    def spoilt_handshake(wire: socket.socket) -> None:
        wire.sendall(spoilt(draw, hello))

    def half_a_handshake(wire: socket.socket) -> None:
        wire.sendall(hello[:draw.randrange(1, len(hello))])
        held.append(wire.dup())  # goes on saying nothing
        if len(held) > 100:
            held.pop(0).close()

    def plain_http(wire: socket.socket) -> None:
        wire.sendall((takeoff + "{}").encode())

    def no_certificate(wire: socket.socket) -> None:
        with outsider.context.wrap_socket(wire.dup(), server_hostname=HERE) as secure:
            secure.sendall((takeoff + "{}").encode())
            assert secure.recv(4096) == b""

    def a_spoilt_request(wire: socket.socket) -> None:
        with station.context.wrap_socket(wire.dup(), server_hostname=HERE) as secure:
            heard.append(secure.version())
            secure.sendall(spoilt(draw, (takeoff + "[]").encode()))
            secure.unwrap()

    kinds = (garbage, spoilt_handshake, half_a_handshake, plain_http, no_certificate, a_spoilt_request)
    before, begin = resident_kb(pid_of("ledgerline-ground")), time.monotonic()
    count = 10_000 if LONG else 500
    for k in range(count):
        with socket.create_connection((HERE, port), timeout=30) as wire:
            try:
                kinds[k % len(kinds)](wire)
                if kinds[k % len(kinds)] is not half_a_handshake:
                    wire.shutdown(socket.SHUT_WR)
                    while wire.recv(4096):
                        pass
            except OSError:  # it was closed meanwhile
                pass
    after = resident_kb(pid_of("ledgerline-ground"))
    assert len(heard) > count // len(kinds) - 2 and set(heard) == {"TLSv1.3"}, "those with a certificate got in"
    print(f"{count} hostile connections in {time.monotonic() - begin:.1f} s, resident {before} to {after} kB")
    assert after < before + 20_000
    assert station.drone("tello1")["phase"] == "waiting"
    for one in held:
        one.close()
    end(flight, tmp_path)
