"""`ledgerline drones`, `missions`, `flights` and `alarms`: flights that are flown by nothing else."""
import http.server
import json
import os
import pathlib
import re
import signal
import subprocess
import threading
import time

from commands import Person
from flights import BIN, assert_nothing_left, fly, no_flight_outlives_its_test, printed
from station import TIMEOUT_S, Station, is_ready

MISSION = pathlib.Path(__file__).resolve().parents[3] / "docs/examples/mission-two.csv"


def take_off_by_commands(person: Person, station: Station, *names: str) -> None:
    person.says("drones", "takeoff", *names)
    for name in names:
        station.wait(name, lambda drone: drone["phase"] == "manual")


def status_of(out: pathlib.Path) -> None:
    """By `ledgerline status`: what runs of this flight, and how old what the ledger has of it is."""
    done = subprocess.run([BIN / "ledgerline", "status", "--json", "--config-dir", out], capture_output=True, text=True, timeout=TIMEOUT_S)
    reported = json.loads(done.stdout)
    ours = {one["program"]: one for one in reported["programs"] if (one["config"] or "").startswith(str(out))}
    assert {"ledgerline-agent", "ledgerline-link", "ledgerline-ground"} <= ours.keys(), reported
    assert reported["not_running"] == [], reported
    assert all(0 <= one["age_s"] < 120 and not one["replaced"] and one["user"] for one in ours.values()), ours
    ledger = next(one for one in reported["ledgers"] if one["config"] == ours["ledgerline-agent"]["config"])
    assert ledger["why"] is None and ledger["peers"][0]["height"] > 3 and ledger["newest_block_age_s"] < 5, ledger
    assert [(one["drone"], "alice" in one["holder"], one["stopped_by"]) for one in ledger["drones"]] == [
        ("tello1", True, None), ("tello2", True, None)], ledger
    assert all(one["state_age_s"] < 5 and one["phase"] in ("on_ground", "flying") for one in ledger["drones"]), ledger
    done = subprocess.run([BIN / "ledgerline", "doctor", "--json", "--config-dir", out], capture_output=True, text=True, timeout=TIMEOUT_S)
    assert any(one["check"] == "disk" and f"{out}/run/ledger:" in one["what"] for one in json.loads(done.stdout)["checks"]), done.stdout


def with_operators(out: pathlib.Path) -> tuple:
    flight = fly(out, "--drones", "2", "--shape", "manual", "--watch", "--operators", "alice,bob")
    station = Station(out, flight)
    for name in ("tello1", "tello2"):
        station.wait(name, is_ready)
    return flight, station, Person(out / "alice", station, out, "alice")


def test_two_operators_fly_by_commands(tmp_path):
    flight, station, alice = with_operators(tmp_path)
    bob, anybody = Person(tmp_path / "bob", station, tmp_path, "bob"), Person(tmp_path / "anybody", station, tmp_path)

    table = anybody.says("drones").splitlines()
    assert len(table) == 3 and table[1].startswith("tello1  waiting  "), table
    assert anybody.json("drones")["drones"][1]["name"] == "tello2"
    assert "sign in first" in anybody.refused("drones", "takeoff", "tello1")
    assert "nothing is in the air" in anybody.says("flights").lower() and anybody.json("flights") == {"flights": []}

    phrase = alice.phrase_file()
    phrase.chmod(0o644)
    assert "chmod 600" in alice.refused("drones", "login", "--operator", "alice", "--pass-phrase-file", phrase)
    assert "403" in bob.refused("drones", "login", "--operator", "alice", "--pass-phrase-file", bob.phrase_file())
    assert "404" in bob.refused("drones", "login", "--operator", "eve", "--pass-phrase-file", bob.phrase_file())
    assert "alice is signed in as Org2MSP" in alice.log_in()
    assert oct(alice.session_file().stat().st_mode & 0o777) == "0o600"
    bob.log_in()
    assert "nobody holds its lease: `ledgerline drones acquire tello1`" in alice.refused("drones", "takeoff", "tello1")

    # Leases: each is on the ledger when its command ends.
    alice.says("drones", "acquire", "--all")
    assert "is held by somebody" in alice.refused("drones", "acquire", "--all")
    assert "by somebody else" in alice.refused("drones", "request", "--all")
    assert all("alice" in drone["lease"]["holder"] for drone in anybody.json("drones")["drones"])
    assert "refused" in bob.refused("drones", "acquire", "tello1")
    bob.says("drones", "request", "tello1", "--priority", "0")
    asked = station.drone("tello1")["requests"][0]
    him = ("--msp", asked["msp"], "--subject", asked["subject"])
    alice.says("drones", "deny", "tello1", *him)
    assert station.drone("tello1")["requests"] == []
    bob.says("drones", "request", "tello1")
    alice.says("drones", "hand_over", "tello1", *him)
    assert "bob" in station.drone("tello1")["lease"]["holder"]
    bob.says("drones", "release", "tello1")
    alice.says("drones", "acquire", "tello1")

    watching = anybody.start("drones", "--watch")
    following = anybody.start("alarms", "--watch")
    take_off_by_commands(alice, station, "tello1", "tello2")
    status_of(tmp_path)
    assert "tello2 is in the air" in alice.refused("drones", "release", "tello2")
    flown = anybody.json("flights")["flights"]
    assert [(one["what"], one["drones"], "alice" in one["by"]) for one in flown] == [("hand", ["tello1"], True), ("hand", ["tello2"], True)]
    assert all(0 < one["since_s"] < TIMEOUT_S for one in flown), flown
    way = tmp_path / "way.csv"
    way.write_text("x,y,z,speed\n0,1.5\n0,0,1.2,0.3\n")
    alice.says("drones", "path", "tello1", way)
    station.wait("tello1", lambda drone: drone["phase"] == "path" or drone["progress"] > 0)
    alice.says("drones", "pause", "tello1")
    station.wait("tello1", lambda drone: drone["paused"])
    assert "paused" in anybody.says("drones")
    alice.says("drones", "resume", "tello1")
    station.wait("tello1", lambda drone: not drone["paused"])
    alice.says("drones", "return", "tello1")
    way.write_text("north,1\n")
    assert f"{way}:1: " in alice.refused("drones", "path", "tello1", way)

    alice.says("drones", "stop", "tello2")
    station.wait("tello2", lambda drone: drone["stopped_by"] and drone["phase"] == "landed")
    assert "stopped by Org2MSP" in anybody.says("alarms") and "link reaches it" not in anybody.says("alarms")
    assert "link reaches it" in anybody.says("alarms", "--all")
    assert "those that are over among them" in anybody.says("alarms", "--help")
    assert anybody.json("alarms")["events"][0]["n"] == 1
    alice.says("drones", "clear_stop", "tello2")
    assert station.drone("tello2")["stopped_by"] == []
    alice.says("drones", "land", "--all", "--wait")
    station.wait("tello1", lambda drone: drone["phase"] == "landed")
    for program, shown in ((watching, "landed"), (following, "stopped by")):
        program.send_signal(signal.SIGINT)
        text = program.communicate(timeout=30)[0]
        assert program.returncode == 0 and shown in text, text
        if program is watching:
            assert text.count("failsafe") > 3, "a table at each change"

    # Elsewhere she signs in again: this session is over, and still stops a drone.
    elsewhere = Person(tmp_path / "elsewhere", station, tmp_path, "alice")
    screen = elsewhere.log_in_at_a_terminal()
    assert "alice is signed in" in screen and alice.phrase_file().read_text().strip() not in screen, "what is typed is not shown"
    assert "is over" in alice.refused("drones", "takeoff", "tello1")
    assert "asking without it" in alice.run("drones").stderr
    assert "without it" not in alice.run("drones", "stop", "tello1").stderr
    assert "CN=alice@" not in str(station.wait("tello1", lambda drone: drone["stopped_by"])["stopped_by"]), "ground has signed it"
    elsewhere.says("drones", "clear_stop", "tello1")
    assert station.drone("tello1")["stopped_by"] == [], "who is signed in clears ground's own stop"
    assert "sign in first" in anybody.refused("drones", "cut", "tello2", "--yes"), "motors off is no onlooker's"
    elsewhere.says("drones", "cut", "tello2")
    station.wait("tello2", lambda drone: "CN=alice@" in str(drone["stopped_by"]))
    assert "lands and is given back" in elsewhere.says("drones", "logout") and not list((elsewhere.home / "ledgerline").iterdir())
    assert "sign in first" in elsewhere.refused("drones", "acquire", "tello2")

    anybody.says("drones", "stop", "--all")
    station.wait("tello1", lambda drone: drone["stopped_by"])
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()
    for verb in ("drones", "missions", "flights", "alarms"):
        assert "is not reached" in anybody.refused(verb)


def test_a_mission_is_flown_by_commands(tmp_path):
    flight, station, alice = with_operators(tmp_path)
    assert alice.json("missions") == {"missions": []}
    alice.log_in()
    alice.says("drones", "acquire", "tello1", "tello2")
    added = alice.json("missions", "add", MISSION)
    assert added["name"] == "mission-two" and added["phase"] == "checked", added
    assert not any(finding["forbids"] for finding in added["findings"]), added
    assert alice.json("missions", "digest", MISSION)["digest"] == added["hash"]
    mission = added["id"]

    def wait(*phases: str) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while (now := alice.json("missions", "show", mission))["phase"] not in phases:
            assert time.monotonic() < deadline, now
            time.sleep(0.1)

    assert "409" in alice.refused("missions", "start", mission)
    alice.says("missions", "approve", mission)
    assert alice.json("missions", "show", mission)["phase"] == "approved", "its approval counts when the command ends"
    at_station = alice.json("missions", "digest", MISSION, "--url", station.url)["at_station"]
    assert at_station["id"] == mission and "alice" in at_station["approvals"][0], at_station

    def printed_by(*words: str) -> dict:
        return json.loads(subprocess.run([BIN / "ledgerline", *words], capture_output=True, text=True, timeout=30, check=True).stdout)

    operator = ("--config", tmp_path / "run" / "operator.toml")
    anchor = printed_by("ledger", "get", *operator, "--json", "anchor/*")["value"]
    until, ground = re.fullmatch(r"mission mission-two may be flown until (\S+) at (.*)", anchor["what"]).groups()
    assert alice.json("missions", "digest", MISSION, "--until", until, "--ground", ground)["approval"] == anchor["digest"]
    assert "alice" in json.dumps(printed_by("control", *operator, "verify", "--digest", anchor["digest"])["anchors"])
    alice.says("missions", "start", mission)
    wait("to_start", "flying")
    flown = alice.json("flights")["flights"]
    assert len(flown) == 1 and flown[0]["mission"] == mission and flown[0]["drones"] == ["tello1", "tello2"] and flown[0]["since_s"] > 0, flown
    assert mission in alice.says("missions")
    assert "409" in alice.refused("missions", "remove", mission)
    alice.says("missions", "pause", mission)
    assert ", paused" in alice.says("missions", "show", mission)
    alice.says("missions", "resume", mission)
    alice.says("missions", "land", mission)
    for name in ("tello1", "tello2"):
        station.wait(name, lambda drone: drone["phase"] == "landed")
    wait("aborted")
    for again in (("start", mission), ("add", MISSION)):
        assert f"its owner removes it (`ledgerline missions remove {mission}`)" in alice.refused("missions", *again)
    alice.says("missions", "remove", mission)
    alice.says("missions", "add", MISSION)
    assert "still counts" in alice.says("missions", "approve", mission), "the ledger has her approval from before"
    assert alice.json("missions", "show", mission)["phase"] == "approved"
    alice.says("missions", "remove", mission)
    assert alice.json("missions") == {"missions": []}
    named = tmp_path / "two.csv"
    named.write_text(MISSION.read_text())
    assert alice.json("missions", "add", named, "--name", "again")["name"] == "again"
    named.write_text("drone,x,y,z,speed\ntello9,far,0,,\n")
    assert f"{named}:2: x" in alice.refused("missions", "add", named)
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()


def test_what_makes_no_sense_is_bad_usage_and_a_wrong_token_is_refused(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch")
    station = Station(tmp_path, flight)
    person = Person(tmp_path / "person", station, tmp_path)
    wrong = tmp_path / "wrong.token"
    wrong.write_text("0" * 64)
    wrong.chmod(0o600)
    for verb in ("drones", "missions", "flights", "alarms"):
        assert f"the token in {wrong} is not that of the station at" in person.refused(verb, "--token-file", wrong)
    wrong.chmod(0o644)
    assert "chmod 600" in person.refused("drones", "--token-file", wrong)
    assert "which station?" in person.misused("drones", LEDGERLINE_STATION="")
    assert "which token?" in person.misused("drones", LEDGERLINE_TOKEN_FILE="")
    assert "without TLS" in person.misused("drones", "--url", "http://192.0.2.1:80")
    config = tmp_path / "run" / "ground.toml"
    assert person.run("drones", "--config", config, LEDGERLINE_STATION="", LEDGERLINE_TOKEN_FILE="").stdout.count("tello1") == 1
    any_port = tmp_path / "any.toml"
    any_port.write_text(config.read_text().replace(station.place, "127.0.0.1:0"))
    assert "port 0" in person.misused("alarms", "--config", any_port)
    for verb in ("takeoff", "land", "stop", "cut"):
        assert "--wait" in person.says("drones", verb, "--help")
    assert "did you mean" not in person.misused("drones", "resume", "tello1", "--all")
    for words in (("stop",), ("land",), ("stop", "tello1", "--all"), ("takeoff",), ("wings",), ("takeoff", "a/b"), ("stop", "--all", "--watch"), ("path", "tello1", "none.csv"),
                  ("hand_over", "tello1", "--msp", "Org2MSP"), ("login",)):
        person.misused("drones", *words)
    for words in (("add", "none.csv"), ("start",), ("start", "../x")):
        person.misused("missions", *words)
    assert "nobody has requested it" in person.refused("drones", "hand_over", "tello1")
    reported = person.refused("drones", "land", "tello8", "tello9")
    assert reported.count("flies here") == 2 and "2 of 2 drones: not done" in reported
    # Without operators ground's own identity signs all, and nobody signs in.
    assert "404" in person.refused("drones", "acquire", "tello1")
    assert "404" in person.refused("drones", "login", "--operator", "alice", "--pass-phrase-file", person.environment["LEDGERLINE_TOKEN_FILE"])
    station.wait("tello1", is_ready)
    take_off_by_commands(person, station, "tello1")
    person.says("drones", "land", "tello1")
    station.wait("tello1", lambda drone: drone["phase"] == "landed")
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 0, printed(tmp_path)
    assert_nothing_left()


class SilentStation(http.server.BaseHTTPRequestHandler):
    """A station that takes orders, and has no answer for who asks for its events."""
    protocol_version = "HTTP/1.1"
    asked: list[str] = []

    def do_GET(self) -> None:
        self.asked.append(self.path)
        down = {"name": "tello1", "phase": "landed", "link_phase": "landed", "stopped_by": ["Org2MSP CN=pilot"]}
        self.answer(*((503, {"error": "no events"}) if "events" in self.path else (200, {"drones": [down]})))

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["Content-Length"] or 0))
        self.asked.append(self.path)
        self.answer(202, {"accepted": True})

    def answer(self, status: int, body: dict) -> None:
        text = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(text)))
        self.end_headers()
        self.wfile.write(text)


def test_what_brings_a_drone_down_is_sent_before_anything_is_asked(tmp_path):
    token = tmp_path / "token"
    token.write_text("0" * 64)
    token.chmod(0o600)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), SilentStation) as station:
        threading.Thread(target=station.serve_forever, daemon=True).start()
        for verb, expected in (("land", 0), ("stop", 0), ("cut", 0), ("takeoff", 1)):
            SilentStation.asked.clear()
            done = subprocess.run([BIN / "ledgerline", "drones", "--wait", verb, "tello1"], capture_output=True, text=True, timeout=TIMEOUT_S,
                                  env={"PATH": os.environ["PATH"], "LEDGERLINE_STATION": f"http://127.0.0.1:{station.server_port}",
                                       "LEDGERLINE_TOKEN_FILE": str(token), "XDG_RUNTIME_DIR": str(tmp_path)})
            assert done.returncode == expected, done.stderr
            first = "/api/v1/events?since=0" if verb == "takeoff" else f"/api/v1/drones/tello1/{verb}"
            assert SilentStation.asked[0] == first, SilentStation.asked
        station.shutdown()
