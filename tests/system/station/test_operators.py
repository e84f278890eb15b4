"""Operators with keys of their own at one ground: commands are signed by the operator."""
import json
import re
import subprocess
import time

from websockets.exceptions import InvalidStatus

from flights import BIN, fly, no_flight_outlives_its_test, printed
from station import Station, take_off, velocity
from test_station import end


class Signed(Station):
    """The station as one operator has it."""

    def __init__(self, station: Station, name: str, pass_phrase: str) -> None:
        self.url, self.place, self.page_token, self.name = station.url, station.place, station.token, name
        self.context = station.context
        self.token = self.page_token
        status, answer = self.ask("POST", "session", {"operator": name, "passphrase": pass_phrase})
        assert status == 200, answer
        self.token, self.identity = answer["session"], answer["identity"]
        self.msp, self.subject = self.identity.split(" ", 1)

    def reported(self, words: str) -> dict:
        """Until an event says so."""
        deadline = time.monotonic() + 60
        while True:
            events = self.ask("GET", "events")[1]["events"]
            found = [event for event in events if words in event["text"]]
            if found:
                return found[-1]
            assert time.monotonic() < deadline, [event["text"] for event in events]
            time.sleep(0.05)


def sign_in(station: Station, out, name: str) -> Signed:
    phrase = re.search(rf"Operator {name}: pass phrase (\w+)", printed(out)).group(1)
    return Signed(station, name, phrase)


def holder(name: str):
    return lambda drone: f"CN={name}@" in drone["lease"]["holder"]


def test_an_ended_session_and_the_pages_token_stop_and_never_cut(tmp_path):
    flight = fly(tmp_path, "--shape", "manual", "--watch", "--operators", "alice")
    station = Station(tmp_path, flight)
    before = sign_in(station, tmp_path, "alice")
    alice = sign_in(station, tmp_path, "alice")  # elsewhere: the session before is over
    alice.say("drones/tello1/acquire")
    station.wait("tello1", holder("alice"))
    take_off(alice, "tello1")
    for path, body in (("drones/tello1/cut", {"confirmed": True}), ("stop", {"cut": True, "confirmed": True})):
        assert before.ask("POST", path, body)[0] == 401, path
        assert station.ask("POST", path, body)[0] == 403, path
        status, refused = alice.ask("POST", path, {**body, "confirmed": False})
        assert status == 409 and "tello1 is in the air" in refused["error"], refused
    with station.stream() as looks, alice.stream() as flies:
        for stream, wanted in ((looks, 403), (flies, 409)):
            stream.send('{"op":"cut","drone":"tello1","id":1}')
            while (message := json.loads(stream.recv(timeout=60)))["op"] != "answer":
                pass
            assert message["id"] == 1 and message["status"] == wanted, message
    assert station.drone("tello1")["phase"] == "manual" and not station.drone("tello1")["stopped_by"]
    # 70 streams with the page's token leave way for a stop: on an open one, and by a new connection.
    with station.stream() as looks:
        streams = []
        for _ in range(70):
            try:
                streams.append(station.stream())
            except InvalidStatus:
                pass
        assert len(streams) == 7, "eight of one address"
        looks.send('{"op":"stop","id":2}')
        station.wait("tello1", lambda drone: drone["phase"] == "landed" and drone["stopped_by"])
        assert station.ask("POST", "stop")[0] == 202
        for stream in streams:
            stream.close_socket()
    alice.say("drones/tello1/clear_stop")
    station.wait("tello1", lambda drone: not drone["stopped_by"])
    end(flight, tmp_path)


def test_each_signs_what_he_asks_for_and_a_drone_obeys_its_holder_alone(tmp_path):
    flight = fly(tmp_path, "--drones", "2", "--shape", "manual", "--watch", "--operators", "alice,bob")
    station = Station(tmp_path, flight)
    station.wait("tello1", lambda drone: drone["link_phase"] == "on_ground")
    assert station.ask("POST", "drones/tello1/takeoff")[0] == 403, "the page's own token flies nothing"
    assert station.ask("POST", "session", {"operator": "alice", "passphrase": "guessed"})[0] == 403
    alice, bob = sign_in(station, tmp_path, "alice"), sign_in(station, tmp_path, "bob")
    assert alice.ask("GET", "operators")[1]["you"] == "alice"
    alice.say("drones/tello1/acquire")
    held = station.wait("tello1", holder("alice"))
    assert "CN=User1@" in held["lease"]["commander"] and held["lease"]["ours"], held
    take_off(alice, "tello1")

    # bob is refused in words, asks, and is handed the drone in the air: it goes on hovering.
    status, refused = bob.ask("POST", "drones/tello1/path", {"waypoints": [{"x": 1, "y": 0}]})
    assert status == 409 and "its lease is held by" in refused["error"], refused
    bob.say("drones/tello1/request")
    asked = station.wait("tello1", lambda drone: drone["requests"])["requests"][0]
    alice.say("drones/tello1/hand_over", {"to": {"msp": asked["msp"], "subject": asked["subject"]}})
    over = station.wait("tello1", holder("bob"))
    assert over["phase"] == "manual" and over["lease"]["epoch"] > held["lease"]["epoch"], over
    with bob.stream() as stream:
        before = station.drone("tello1")["position"]
        for _ in range(30):
            stream.send(velocity("tello1", 0.4))
            time.sleep(0.05)
    assert station.drone("tello1")["position"][0] - before[0] > 0.2, "bob flies it"
    assert alice.ask("POST", "drones/tello1/path", {"waypoints": [{"x": 1, "y": 0}]})[0] == 409
    time.sleep(0.5)
    assert station.drone("tello1")["phase"] == "manual", "alice does not any more"

    # In the air it is given back only where that is confirmed.
    status, refused = bob.ask("POST", "drones/tello1/release")
    assert status == 409 and "tello1 is in the air" in refused["error"], refused

    # A stop is its stopper's own, and so is clearing it.
    alice.say("drones/tello1/stop")
    stopped = station.wait("tello1", lambda drone: drone["phase"] == "landed" and drone["stopped_by"])
    assert stopped["stopped_by"] == [alice.identity]
    bob.say("drones/tello1/clear_stop")
    bob.reported("bob: clear the stop: refused")
    alice.say("drones/tello1/clear_stop")
    station.wait("tello1", lambda drone: not drone["stopped_by"])

    # What is confirmed is done: nobody commands it, and its failsafe lands it.
    bob.say("drones/tello1/takeoff")
    station.wait("tello1", lambda drone: drone["phase"] == "manual")
    bob.say("drones/tello1/release", {"confirmed": True})
    station.wait("tello1", lambda drone: not drone["lease"]["holder"] and drone["link_phase"] == "landed")
    bob.say("drones/tello1/acquire")
    station.wait("tello1", holder("bob"))

    # Drones of an operator who leaves in flight are landed, and their leases released.
    bob.say("drones/tello1/takeoff")
    station.wait("tello1", lambda drone: drone["phase"] == "manual")
    # Anybody signed in may land it; who did is not on the ledger.
    alice.say("drones/tello1/land")
    station.wait("tello1", lambda drone: drone["phase"] == drone["link_phase"] == "landed")
    assert alice.reported("land, asked for by alice")["drone"] == "tello1"
    bob.say("drones/tello1/takeoff")
    station.wait("tello1", lambda drone: drone["phase"] == "manual")
    assert bob.ask("DELETE", "session")[0] == 202
    station.wait("tello1", lambda drone: drone["phase"] == "landed" and not drone["lease"]["holder"])
    assert bob.ask("POST", "drones/tello1/takeoff")[0] == 401, "his session is over"
    run = tmp_path / "run"
    reported = json.loads(subprocess.run([BIN / "ledgerline", "audit", "--config", run / "operator.toml", "--json", "-", "--timeout", "2"],
                                     capture_output=True, text=True, timeout=60).stdout)
    commanded = [one["who"] for one in reported["drones"]["tello1"]["commands"]]
    for name in ("alice", "bob"):
        assert f"Org2MSP/User1@org2.ledgerline under Org2MSP/{name}@org2.ledgerline's lease" in commanded, commanded
    stops = [word for word in reported["drones"]["tello1"]["words"] if word["what"] == "stop"]
    assert all("alice@" in json.dumps(stop) for stop in stops) and stops, stops
    end(flight, tmp_path)  # what went wrong was over with the next take-off
    assert "ENCRYPTED" in (run / "operators" / "alice" / "keystore" / "priv_sk").read_text()
    logs = "".join(log.read_text(errors="replace") for log in run.glob("*.log"))
    assert "tello1: land, asked for by alice" in logs and "tello1: take off, asked for by bob" in logs
    for secret in (alice.token, bob.token, *re.findall(r"pass phrase (\w+)", printed(tmp_path))):
        assert secret not in logs, "no secret is in a log"
