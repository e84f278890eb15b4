"""Certificates renewed and revoked while a drone flies, and what the station says of them."""
import contextlib
import mmap
import os
import pathlib
import signal
import subprocess
import time
import tomllib
import types

import pytest
from commands import Person
from fabric import BIN, FABRIC, fabric, needs_fabric
from flights import fly, no_flight_outlives_its_test, printed, wait_for_flight  # noqa: F401: a fixture
from ledgers import Authority
from programs import organisation
from station import Station
from test_authority import identity, needs_ca, of_authority
from trace_file import TraceKind, records

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
TIMEOUT_S = 120
HOLD, LAND = 1, 3  # FailsafeMode


class Host:
    """A program of the flight, and where its identity is."""

    def __init__(self, run: pathlib.Path, program: str, msp: pathlib.Path | None = None):
        """`msp`: where it is not that of its [ledger]."""
        self.run, self.program = run, program
        if msp:
            self.msp = msp
            return
        ledger = tomllib.loads((run / f"{program}.toml").read_text())["ledger"]
        self.msp = run / ledger["msp_dir"]
        self.organisation = int(ledger["msp_id"].removeprefix("Org").removesuffix("MSP"))
        self.user = self.msp.parent.name.split("@")[0]
        self.authority = run / "ledger" / "ca" / f"org{self.organisation}.ledgerline"

    def certificate(self) -> bytes:
        return next((self.msp / "signcerts").iterdir()).read_bytes()

    def renew(self) -> None:
        before = self.certificate(), self.keys()
        identity("renew", *of_authority(self.authority), "--msp-dir", self.msp)
        assert self.certificate() != before[0] and self.keys() != before[1] and len(self.keys()) == 1

    def put(self, issued: dict) -> None:
        """As `ledgerline identity` does, in a program's folder."""
        old = next((self.msp / "keystore").iterdir())
        key = old.with_name(f"{time.monotonic_ns()}_sk")
        key.touch(0o600)
        key.write_text(issued["key"])
        certificate = next((self.msp / "signcerts").iterdir())
        (self.msp / "new").write_text(issued["certificate"])
        (self.msp / "new").rename(certificate)
        old.unlink()

    def keys(self) -> list[bytes]:
        return [key.read_bytes() for key in (self.msp / "keystore").iterdir()]

    def log(self) -> str:
        return (self.run / f"{self.program}.log").read_text(errors="replace")

    def says(self, words: str) -> bool:
        return words in self.log()

    def writes_as(self, certificate: bytes) -> bool:
        """In a block of the chain, as a peer has it."""
        for file in (self.run / "ledger").rglob("chains/chains/teleop/blockfile_*"):
            with open(file, "rb") as opened, contextlib.closing(mmap.mmap(opened.fileno(), 0, prot=mmap.PROT_READ)) as blocks:
                if blocks.find(certificate) >= 0:
                    return True
        return False


def wait_until(what: str, true, flight: subprocess.Popen, out: pathlib.Path) -> None:
    deadline = time.monotonic() + TIMEOUT_S
    while not true():
        assert flight.poll() is None, printed(out)
        assert time.monotonic() < deadline, f"{what}: not so\n{printed(out)}"
        time.sleep(0.2)


def modes(run: pathlib.Path, since_ns: int) -> list[int]:
    return [r.extra for r in records(run / "link.trace") if r.kind == TraceKind.MODE and r.t_ns > since_ns]


def applied(run: pathlib.Path, since_ns: int) -> int:
    return sum(1 for r in records(run / "link.trace") if r.kind == TraceKind.COMMAND_APPLIED and r.t_ns > since_ns)


def test_a_renewed_certificate_is_not_noticed_by_the_drone_and_a_revoked_one_lands_it(tmp_path):
    needs_ca()
    flight = fly(tmp_path, "--ledger", "fabric", "--ca", "--seconds", "600")
    wait_for_flight(tmp_path, flight)
    run = tmp_path / "run"
    hosts = [Host(run, "agent"), Host(run, "ground")]
    for host in hosts:
        host.renew()
    for host in hosts:
        wait_until(f"{host.program} has taken it", lambda: host.says("has a renewed certificate"), flight, tmp_path)
        wait_until(f"{host.program} writes as it", lambda: host.writes_as(host.certificate()), flight, tmp_path)
    seen_ns = time.monotonic_ns()
    wait_until("new commands are flown", lambda: applied(run, seen_ns) >= 3, flight, tmp_path)
    assert LAND not in modes(run, 0)
    revoked_ns = time.monotonic_ns()
    ground = hosts[1]
    taken = fabric("revoke", "--dir", run / "ledger", "--tools", FABRIC, "--org", str(ground.organisation), "--user",
                   ground.user)
    assert taken.returncode == 0, taken.stdout + taken.stderr
    # Behind the plan that it has; ground itself sees no state any more, and cannot say how it went.
    wait_until("the drone lands", lambda: LAND in modes(run, revoked_ns), flight, tmp_path)
    assert HOLD in modes(run, revoked_ns), modes(run, revoked_ns)
    wait_until("ground says why", lambda: ground.says("access denied") or ground.says("FORBIDDEN"), flight, tmp_path)
    wait_until("link says why", lambda: "land (held_too_long)" in (run / "link.log").read_text(), flight, tmp_path)
    assert applied(run, time.monotonic_ns() - 2 * 10**9) == 0, "commands of who is revoked are flown"


@pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1: two more flights on Fabric")
@pytest.mark.parametrize("where", ["endorser", "within"])
def test_an_endorser_goes_on_with_its_renewed_certificate(tmp_path, where):
    needs_fabric()
    flight = fly(tmp_path, "--ledger", "fabric", "--seconds", "100", "--endorser" if where == "endorser" else "--endorser-within")
    wait_for_flight(tmp_path, flight)
    run = tmp_path / "run"
    msp = next((run / "ledger/crypto/peerOrganizations/org1.ledgerline/peers").glob("endorser0*")) / "msp"
    host = Host(run, "endorser" if where == "endorser" else "agent", msp)
    assert host.writes_as(host.certificate()), "it endorses"
    subject = subprocess.run(["openssl", "x509", "-noout", "-subject", "-nameopt", "compat", "-in", next((msp / "signcerts").iterdir())],
                             capture_output=True, text=True, check=True).stdout.split("=", 1)[1].strip()
    ledger = types.SimpleNamespace(organisation=lambda number: organisation(run / "ledger", number))
    authority = Authority(ledger, 1, tmp_path / "authority")
    host.put(authority.issue("endorser0", time.time(), lasts_s=90 * 86400, subject=subject))
    wait_until("it has taken it", lambda: host.says("has a renewed certificate"), flight, tmp_path)
    wait_until("it endorses as it", lambda: host.writes_as(host.certificate()), flight, tmp_path)
    assert not host.says("refused"), host.log()
    assert LAND not in modes(run, 0)
    flight.send_signal(signal.SIGINT)
    flight.wait(TIMEOUT_S)


def test_ends_and_refusals_are_alarms_of_the_station(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    person = Person(tmp_path / "home", station, tmp_path)
    run = tmp_path / "run"
    agent, ground = Host(run, "agent"), Host(run, "ground")

    def issue(host: Host, user: str, days: float) -> dict:
        ledger = types.SimpleNamespace(organisation=lambda number: organisation(run / "ledger", number))
        authority = Authority(ledger, host.organisation, tmp_path / f"ca{time.monotonic_ns()}")
        return authority.issue(user, time.time(), lasts_s=days * 86400 + 3600)

    def alarms(words: str) -> list[str]:
        return [line for line in person.says("alarms").splitlines() if words in line]

    agent.put(issue(agent, agent.user, 20))
    ground.put(issue(ground, ground.user, 2))
    wait_until("the agent's end is reported", lambda: alarms(f"agent Org{agent.organisation}MSP"), flight, tmp_path)
    assert "ends in 20 days" in alarms(f"agent Org{agent.organisation}MSP")[0]
    wait_until("ground's own, too", lambda: alarms("ends in 2 days"), flight, tmp_path)
    before = ground.certificate()
    ground.put(issue(ground, "Somebody", 100))
    wait_until("another person is refused", lambda: alarms("of another subject, CN=Somebody"), flight, tmp_path)
    assert ground.certificate() != before and not alarms("for 100 days")
    events = person.json("alarms")["events"]
    levels = {e["text"].split(": ")[0]: e["level"] for e in events}
    assert {level for text, level in levels.items() if "ends in 20 days" in text} == {"warning"}, levels
    assert {level for text, level in levels.items() if "ends in 2 days" in text or "refused" in text} == {"alarm"}, levels
