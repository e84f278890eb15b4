"""Two channels: drones of two organisations, an agent and a ground on both, and what each may."""
import json
import os
import pathlib
import re
import shutil
import subprocess
import time

import findings
import pytest
from drone_host import Drone, Host
from fabric import BIN, needs_fabric
from ledgers import Embedded, Fabric, tables
from station import Station, take_off
from test_operators import Signed

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
only_long = pytest.mark.skipif(not LONG, reason="LEDGERLINE_LONG=1")
TIMEOUT_S = 120


class Ledgers:
    """Channels teleop and yard of the same three organisations: of one network, or of an embedded node each."""

    def __init__(self, directory: pathlib.Path, fabric: bool):
        if fabric:
            self.teleop = self.yard = Fabric(directory / "ledger", "--channel", "teleop", "--channel", "yard")
        else:
            self.teleop = Embedded(directory / "ledger", "--batch-count", "1")
            shutil.copytree(self.teleop.directory / "crypto", directory / "yard" / "crypto")
            self.yard = Embedded(directory / "yard", "--batch-count", "1", "--channel", "yard")
        self.all = list({id(one): one for one in (self.teleop, self.yard)}.values())

    def tables(self, organisation: int, user: str = "User1") -> str:
        """Of a program on both."""
        text = f'[[channel]]\nname = "yard"\nconfig_block = "{self.yard.directory}/yard.block"\n'
        if self.yard is not self.teleop:
            text += 'endpoint = "{}"\ntls_ca = "{}"\n'.format(*self.yard.peer(organisation))
        return tables(self.teleop, organisation, user, endorsers=True) + text

    def yard_tables(self, organisation: int, user: str = "User1") -> str:
        """Of a program on yard alone."""
        text = tables(self.yard, organisation, user, endorsers=True).replace("teleop.block", "yard.block")
        return text.replace("[ledger]\n", '[ledger]\nchannel = "yard"\n')

    def stop(self) -> None:
        for one in self.all:
            one.stop()


@pytest.fixture(params=["embedded", "fabric"] if LONG else ["embedded"])
def ledgers(request, tmp_path):
    if request.param == "fabric":
        needs_fabric()
    made = Ledgers(tmp_path, request.param == "fabric")
    yield made
    made.stop()


class People:
    """Operators and administrators of both organisations, on either channel."""

    def __init__(self, directory: pathlib.Path, ledgers: Ledgers):
        self.directory, self.ledgers = directory, ledgers

    def control(self, channel: str, organisation: int, user: str, *words, whole: bool = False) -> subprocess.CompletedProcess:
        file = self.directory / f"control-{channel}-{organisation}-{user}.toml"
        text = (self.ledgers.yard_tables(organisation, user) if channel == "yard"
                else tables(self.ledgers.teleop, organisation, user, endorsers=True))
        file.write_text(text if whole else text.split("[[msp]]")[0])
        return subprocess.run([BIN / "ledgerline", "control", "--config", file, *words], capture_output=True, text=True, timeout=60)

    def done(self, *words) -> str:
        ended = self.control(*words)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    def refused(self, *words) -> str:
        ended = self.control(*words)
        assert ended.returncode == 1, ended.stdout
        return ended.stderr

    def enroll_operator(self, channel: str, organisation: int) -> None:
        self.done(channel, organisation, "Admin", "enroll", "--msp", f"Org{organisation}MSP", "--cert",
                  self.cert(organisation, "User2"), "--role", "operator")

    def cert(self, organisation: int, user: str) -> pathlib.Path:
        return next((self.ledgers.teleop.msp_dir(organisation, user) / "signcerts").iterdir())


def a_drone_on_each(people: People) -> None:
    """Both held by Org1's User2."""
    for channel, drone in (("teleop", "tello1"), ("yard", "tello2")):
        people.enroll_operator(channel, 1)
        people.done(channel, 1, "User2", "acquire", drone)


def host_on_both(directory: pathlib.Path, ledgers: Ledgers) -> Host:
    return Host(directory / "host1", ledgers.all, ledgers.tables(1), [Drone("tello1", 1), Drone("tello2", 2, "yard")])


def ground(directory: pathlib.Path, name: str, tables: str, drones: str, flight: str = "laps = 1\nside_m = 1\n") -> subprocess.Popen:
    file = directory / f"{name}.toml"
    file.write_text(f'{tables}[output]\nsummary = "{directory}/{name}.json"\nstatus_period_ms = 100\n[flight]\n{flight}'
                    f"[dds]\nlocal_only = true\n{drones}")
    return subprocess.Popen([BIN / "ledgerline-ground", "--config", file], text=True,
                            stdout=open(directory / f"{name}.out", "w"), stderr=open(directory / f"{name}.log", "w"))


ON_BOTH = '[[drone]]\nname = "tello1"\n[[drone]]\nname = "tello2"\nchannel = "yard"\n'


def test_each_organisation_flies_its_own_drones_on_two_channels(tmp_path, ledgers):
    people = People(tmp_path, ledgers)
    # tello1 and tello2 are Org1's on either channel; south is Org2's, on yard alone.
    people.enroll_operator("teleop", 1)
    people.enroll_operator("yard", 1)
    people.enroll_operator("yard", 2)
    people.done("yard", 2, "Admin", "enroll", "--msp", "Org2MSP", "--cert", people.cert(2, "User1"), "south")
    people.done("teleop", 1, "User2", "acquire", "tello1")
    people.done("yard", 1, "User2", "acquire", "tello2")
    people.done("yard", 2, "User2", "acquire", "south")
    assert "south" in people.done("yard", 1, "User2", "show"), "a member sees all drones of the channel"
    assert "south" not in people.done("teleop", 2, "User2", "show")
    assert "grant" in people.refused("yard", 1, "User2", "acquire", "south")
    assert "grant" in people.refused("yard", 1, "User2", "stop", "south")
    assert "enrolled" in people.refused("teleop", 1, "User2", "acquire", "south"), "a channel knows its own drones alone"

    hosts = [host_on_both(tmp_path, ledgers),
             Host(tmp_path / "host2", [ledgers.yard], ledgers.yard_tables(2), [Drone("south", 1)], pose="tello1")]
    grounds = [ground(tmp_path, "ground1", ledgers.tables(1, "User2"), ON_BOTH),
               ground(tmp_path, "ground2", ledgers.yard_tables(2, "User2"), '[[drone]]\nname = "south"\n')]
    try:
        for k, one in enumerate(grounds, 1):
            assert one.wait(TIMEOUT_S) == 0, (tmp_path / f"ground{k}.log").read_text()[-3000:] + "".join(host.log() for host in hosts)
    finally:
        for one in grounds:
            one.kill()
        for host in hosts:
            host.stop()
    on_both = json.loads((tmp_path / "host1" / "agent.json").read_text())["channels"]
    of_south = json.loads((tmp_path / "host2" / "agent.json").read_text())
    assert [(one["channel"], [drone["name"] for drone in one["drones"]]) for one in (*on_both, of_south)] == [
        ("teleop", ["tello1"]), ("yard", ["tello2"]), ("yard", ["south"])]
    for one in (*on_both, of_south):
        commands = one["drones"][0]["commands"]
        assert commands["on_ledger"] > 50 and commands["verified"] > 0.9 * commands["on_ledger"], commands
        assert one["integrity_violations"] == 0 and one["drones"][0]["states"]["on_ledger"] > 50, one


@only_long
def test_a_channel_that_dies_lands_its_own_drone_alone(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    a_drone_on_each(People(tmp_path, ledgers))
    host = host_on_both(tmp_path, ledgers)
    flight = ground(tmp_path, "ground1", ledgers.tables(1, "User2"), ON_BOTH, "laps = 4\nside_m = 1\n")
    try:
        deadline = time.monotonic() + TIMEOUT_S
        while (tmp_path / "ground1.out").read_text().count('"phase":"path"') < 40:  # of both, for two seconds
            assert flight.poll() is None and time.monotonic() < deadline, (tmp_path / "ground1.log").read_text()[-3000:] + host.log()
            time.sleep(0.1)
        ledgers.yard.kill()
        assert flight.wait(TIMEOUT_S) == 1, "tello2 does not finish"
    finally:
        flight.kill()
        host.stop()
        ledgers.teleop.stop()
    teleop, yard = json.loads((tmp_path / "ground1.json").read_text())["channels"]
    assert teleop["drones"][0]["finished"] and teleop["drones"][0]["landed"], teleop
    assert not yard["drones"][0]["finished"]
    said = [json.loads(line) for line in (host.directory / "link.log").read_text().splitlines() if line.startswith('{"link"')]
    modes = lambda name: {drone["mode"] for line in said for drone in line["link"]["drones"]
                          if drone["name"] == name and drone["phase"] == "flying"}
    assert modes("tello1") == {"none"}, "the other channel's silence is nothing to it"
    assert "hold" in modes("tello2")


@only_long
def test_a_start_without_one_channel_flies_the_drones_of_the_other_which_join_later(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    a_drone_on_each(People(tmp_path, ledgers))
    ledgers.yard.stop()
    host = host_on_both(tmp_path, ledgers)
    flight = ground(tmp_path, "ground1", ledgers.tables(1, "User2"), ON_BOTH, "laps = 1\nside_m = 1\n")
    grounds = [flight]
    try:
        assert flight.wait(TIMEOUT_S) == 1, "tello2 is not flown"
        first = {one["channel"]: one["drones"][0] for one in json.loads((tmp_path / "ground1.json").read_text())["channels"]}
        assert first["teleop"]["finished"] and not first["yard"]["finished"], first
        assert "channel yard: " in (host.directory / "agent.log").read_text()
        ledgers.yard.start()
        grounds.append(ground(tmp_path, "ground2", ledgers.yard_tables(1, "User2"), '[[drone]]\nname = "tello2"\nnumber = 2\n'))
        assert grounds[-1].wait(TIMEOUT_S) == 0, (tmp_path / "ground2.log").read_text()[-3000:] + host.log()
    finally:
        for one in grounds:
            one.kill()
        host.stop()
        ledgers.stop()


def test_nobody_is_enrolled_or_granted_anything_who_cannot_exist(tmp_path):
    ledgers = Ledgers(tmp_path, False)
    people = People(tmp_path, ledgers)

    def enroll(cert: pathlib.Path):
        return people.control("teleop", 1, "Admin", "enroll", "--msp", "Org1MSP", "--cert", cert, "tello20")

    try:
        refused = enroll(people.cert(2, "User1"))
        assert refused.returncode == 1 and "is no certificate of Org1MSP: it was issued by " in refused.stderr, refused.stderr
        assert "ca.org2.ledgerline" in refused.stderr
        first, second = enroll(people.cert(1, "User1")), enroll(people.cert(1, "User2"))
        assert first.returncode == second.returncode == 0, first.stderr + second.stderr
        assert "host was" not in first.stderr and re.search("tello20: host was .*User1@org1.ledgerline.* of Org1MSP", second.stderr)
        assert json.loads(second.stdout)

        grant = ("teleop", 1, "Admin", "grant", "--fly", "tello20", "--msp")
        misspelt = people.control(*grant, "Org2MPS", whole=True)
        assert misspelt.returncode == 1 and "did you mean Org2MSP?" in misspelt.stderr, misspelt.stderr
        foreign = people.refused(*grant, "Org2MSP", "--cert", people.cert(1, "User1"))
        assert "is no certificate of Org2MSP" in foreign, "by the authorities in the config block"
        assert people.control(*grant, "Org2MSP", "--cert", people.cert(2, "User1"), whole=True).returncode == 0

        people.enroll_operator("teleop", 1)
        people.done("teleop", 1, "User2", "acquire", "tello20")
        people.done("teleop", 1, "User2", "release", "tello20")
        people.done("teleop", 1, "Admin", "enroll", "--msp", "Org1MSP", "--cert", people.cert(1, "User2"), "--role", "auditor")
        assert "is neither operator nor supervisor" in people.refused("teleop", 1, "User2", "acquire", "tello20")
    finally:
        ledgers.stop()


@only_long
def test_a_drone_that_is_enrolled_late_ends_no_agent_and_joins(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    people = People(tmp_path, ledgers)
    host = Host(tmp_path / "host1", ledgers.all, ledgers.tables(1), [Drone("tello1", 1), Drone("late", 2, "yard")])
    file = host.directory / "agent.log"
    log = lambda: file.read_text() if file.exists() else ""

    def wait_for(words: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while words not in log():
            assert not (host.directory / "agent.json").exists() and time.monotonic() < deadline, log()[-3000:]
            time.sleep(0.2)

    try:
        wait_for("ready")
        people.enroll_operator("yard", 1)  # a block, at which the records are read, for a minute
        wait_for("tried again at its next block")
        people.done("yard", 1, "Admin", "enroll", "--msp", "Org1MSP", "--cert", people.cert(1, "User1"), "late")
        time.sleep(3)
    finally:
        host.stop()
        ledgers.stop()
    teleop, yard = (one["drones"][0]["states"]["on_ledger"] for one in json.loads((host.directory / "agent.json").read_text())["channels"])
    assert teleop > 500 and yard > 20, log()[-3000:]


class OfGround(Station):
    """The station of a ground that no launcher started."""

    def __init__(self, directory: pathlib.Path, name: str, token_file: pathlib.Path, ground: subprocess.Popen):
        deadline = time.monotonic() + TIMEOUT_S
        while not (found := re.search(r"(http://([\d.:]+))", (directory / f"{name}.out").read_text())):
            assert ground.poll() is None and time.monotonic() < deadline, (directory / f"{name}.log").read_text()
            time.sleep(0.05)
        self.url, self.place = found.groups()
        self.token = token_file.read_text().strip()


def lock_key(ledgers: Ledgers, organisation: int, user: str, folder: pathlib.Path, pass_phrase: str) -> None:
    """An operator's folder, as the station wants it."""
    msp = ledgers.teleop.msp_dir(organisation, user)
    shutil.copytree(msp / "signcerts", folder / "signcerts")
    (folder / "keystore").mkdir()
    key = folder / "keystore" / "key.pem"
    subprocess.run(["openssl", "pkcs8", "-topk8", "-in", next((msp / "keystore").iterdir()), "-out", key,
                    "-passout", f"pass:{pass_phrase}"], check=True)
    key.chmod(0o600)


def test_an_operator_at_one_page_flies_and_stops_drones_of_both_channels(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    people = People(tmp_path, ledgers)
    for channel in ("teleop", "yard"):
        people.enroll_operator(channel, 1)
    lock_key(ledgers, 1, "User2", tmp_path / "operators" / "alice", "phrase")
    host = host_on_both(tmp_path, ledgers)
    service = f'[service]\nlisten = "127.0.0.1:0"\ntoken_file = "{tmp_path}/token"\noperators = "{tmp_path}/operators"\n'
    flight = ground(tmp_path, "ground1", ledgers.tables(1, "Admin"), service + ON_BOTH, 'shape = "manual"\n')
    try:
        alice = Signed(OfGround(tmp_path, "ground1", tmp_path / "token", flight), "alice", "phrase")
        for name in ("tello1", "tello2"):  # each call on its drone's channel
            alice.wait(name, lambda drone: drone["link_phase"] == "on_ground")
            alice.say(f"drones/{name}/acquire")
            alice.wait(name, lambda drone: "CN=User2@" in drone["lease"]["holder"])
        for name in ("tello1", "tello2"):
            take_off(alice, name)
        alice.say("stop", {})
        for name in ("tello1", "tello2"):
            alice.wait(name, lambda drone: drone["link_phase"] in ("landed", "on_ground"))
            assert any("CN=User2@" in event["text"] for event in alice.ask("GET", "events")[1]["events"]
                       if event["drone"] == name and event["text"].startswith("stopped by Org1MSP"))
        flight.terminate()
        flight.wait(TIMEOUT_S)
    except Exception:
        print((tmp_path / "ground1.log").read_text()[-3000:], host.log())
        raise
    finally:
        flight.kill()
        host.stop()
        ledgers.stop()
    for channel in json.loads((tmp_path / "ground1.json").read_text())["channels"]:
        assert channel["transactions"]["committed"] > 2 and channel["transactions_altered"] == 0, channel


def test_doctor_looks_at_each_channel(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    drones = '[[drone]]\nname = "tello1"\n[[drone]]\nname = "moon"\nchannel = "yard"\n'

    def findings(text: str) -> list[dict]:
        (tmp_path / "agent.toml").write_text(text + drones)
        done = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", tmp_path, "--json"], capture_output=True, text=True, timeout=60)
        return json.loads(done.stdout)["checks"]

    try:
        seen = findings(ledgers.tables(1))
        wrong = findings(ledgers.tables(1).replace("yard.block", "../ledger/teleop.block"))
        keyless = findings(re.sub('msp_dir = ".*"', f'msp_dir = "{tmp_path}/none"', ledgers.tables(1)))
    finally:
        ledgers.stop()
    words = [one["what"] for one in seen if one["check"] == "contract"]
    assert [word.split(":")[0] for word in words] == ["channel teleop", "channel yard"], words
    assert any("peer of agent.toml, channel yard" in one["what"] and one["verdict"] == "ok" for one in seen), seen
    unknown = [one["what"] for one in seen if one["verdict"] == "broken" and one["drone"] == "moon"]
    assert unknown and unknown[0].startswith("channel yard: "), seen
    anchors = [one for one in wrong if one["problem"] == "anchor_wrong"]
    assert len(anchors) == 1 and "agent.toml, channel yard: it is of channel teleop" in anchors[0]["what"], anchors
    assert [one["problem"] for one in keyless if one["check"] in ("identity", "ledger")] == ["key_missing", "certificate_missing"], "reported once, not by each channel"


def test_doctor_looks_at_the_file_of_each_channel_that_an_operator_or_administrator_has(tmp_path):
    ledgers = Ledgers(tmp_path, fabric=False)
    own = tmp_path / "own"
    shutil.copytree(ledgers.yard.msp_dir(2, "User2"), own)
    key = next((own / "keystore").iterdir())
    folder = tmp_path / "etc"
    folder.mkdir()
    plain = lambda text: text.split("[[msp]]")[0]
    for name, text in (("operator", tables(ledgers.teleop, 2, "User2")), ("admin", tables(ledgers.teleop, 2, "Admin")),
                       ("admin-yard", ledgers.yard_tables(2, "Admin"))):
        (folder / f"{name}.toml").write_text(plain(text))
    yard = plain(ledgers.yard_tables(2, "User2")).replace(str(ledgers.yard.msp_dir(2, "User2")), str(own))
    (folder / "operator-yard.toml").write_text(yard)

    def doctor() -> dict:
        return findings.of_doctor(subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", folder, "--json"], capture_output=True,
                                                 text=True, timeout=60))

    broken = lambda found: {problem for problem, each in found.items() if each["verdict"] == "broken"}
    try:
        assert not broken(doctor())
        key.chmod(0o644)
        found = doctor()
        assert broken(found) == {"key_open"} and str(key) in found["key_open"]["what"], found
        subprocess.run(["sh", "-euc", re.search("`(.+?)`", found["key_open"]["cure"]).group(1)], check=True)
        assert not broken(doctor())
        (folder / "operator-yard.toml").write_text(yard.replace("yard.block", "../ledger/teleop.block"))
        assert broken(found := doctor()) == {"anchor_wrong"} and "operator-yard.toml" in found["anchor_wrong"]["what"], found
        (folder / "operator-yard.toml").write_text(yard)
        (folder / "admin-yard.toml").write_text("[ledger]\nchanel = 1\n")
        assert "admin-yard.toml" in doctor()["config_wrong"]["what"]
        (folder / "admin-yard.toml").unlink()
        (folder / "admin.toml").unlink()
        missing = subprocess.run([BIN / "ledgerline", "doctor", "--config-dir", folder, "--role", "admin", "--json"], capture_output=True,
                                 text=True, timeout=60)
        assert "config_missing" in findings.of_doctor(missing)
    finally:
        ledgers.stop()
