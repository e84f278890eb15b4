"""A drone that nobody tells where it is, flown by ROS 2 topics through the ledger: no motion capture, no odometry of its own."""
import concurrent.futures
import contextlib
import json
import math
import signal
import subprocess
import threading
import time

from cyclonedds.core import Policy
from flights import (BIN, POSES, SAFE, assert_nothing_left, deployment, fly, no_flight_outlives_its_test, pid_of, printed, result,
                     somebody_elses_drones)
from ros import (TIMEOUT_S, BatteryState, DiagnosticArray, Empty, Header, Odometry, Pose, PoseStamped, Quaternion, Outsider, Time, Twist,
                 Vector3, Writer)
from trace_file import TraceKind, records

MAX_S = "300"  # of a flight whose test is gone


class Teleop:
    """Keyboard or joystick: a pilot who sees the drone and has nothing else. What link says of itself is all that is read."""

    def __init__(self, outsider: Outsider, name: str):
        self.name = name
        self.odom = outsider.reads(f"/{name}/odom", Odometry)
        self.battery = outsider.reads(f"/{name}/battery", BatteryState)
        self.diagnostics = outsider.reads("/diagnostics", DiagnosticArray, Policy.Durability.TransientLocal)
        self.cmd_vel = outsider.writes(f"/{name}/cmd_vel", Twist)
        self.words = {word: outsider.writes(f"/{name}/{word}", Empty) for word in ("takeoff", "land")}

    def say(self, word: str) -> None:
        self.words[word].say(Empty())

    def take_off(self) -> None:
        """Presses again until it goes up, as a person does: link may yet have to find the drone."""
        begin = pressed = time.monotonic()
        self.say("takeoff")
        while not any(phase == "taking_off" for phase, *_ in self.transitions()):
            assert time.monotonic() < begin + TIMEOUT_S, self.transitions()
            if time.monotonic() > pressed + 2:
                self.say("takeoff")
                pressed = time.monotonic()
            time.sleep(0.02)

    def fly(self, seconds: float, forward: float = 0.0, turn: float = 0.0) -> tuple[float, float]:
        """20 times a second. From when until when."""
        begin = time.monotonic()
        while time.monotonic() < begin + seconds:
            self.cmd_vel.say(Twist(Vector3(forward, 0.0, 0.0), Vector3(0.0, 0.0, turn)))
            time.sleep(0.05)
        return begin, time.monotonic()

    def transitions(self) -> list[tuple[str, str, str]]:
        """(phase, mode, cause), as they came through the ledger."""
        reported = [{value.key: value.value for value in status.values} for message in self.diagnostics.take()
                for status in message.status if status.name == f"{self.name}/failsafe"]
        return [(each["phase"], each["mode"], each["cause"]) for each in reported]

    def wait(self, phase: str, since: int = 0) -> None:
        self.diagnostics.wait(lambda _: any(each[0] == phase for each in self.transitions()[since:]))


def connect(*pilots: Teleop) -> None:
    writers = [writer for pilot in pilots for writer in (pilot.cmd_vel, *pilot.words.values())]
    with concurrent.futures.ThreadPoolExecutor(len(writers)) as pool:
        list(pool.map(Writer.wait_for_reader, writers))


def wait_for_states(pilot: Teleop, out, flight) -> None:
    """Of a drone that link hears."""
    def look(all):
        assert flight.poll() is None, printed(out)
        return all and all[-1].percentage > 0
    pilot.battery.wait(look)


class Truth:
    """Where the simulator had a drone."""

    def __init__(self, out, drone: int):
        self.rows = [(r[0] / 1e9, r[6:10]) for r in records(out / "run" / "sim.trace") if r[1] == TraceKind.TRUTH and r[2] == drone]

    def at(self, t: float) -> tuple[float, float, float, float]:
        return min(self.rows, key=lambda row: abs(row[0] - t))[1]

    def moved(self, since: float, until: float) -> tuple[float, float, float]:
        """Ahead and to the left of where its nose was, and the turn."""
        (x, y, _, nose), (x2, y2, _, nose2) = self.at(since), self.at(until)
        dx, dy = x2 - x, y2 - y
        return (dx * math.cos(nose) + dy * math.sin(nose), -dx * math.sin(nose) + dy * math.cos(nose),
                math.remainder(nose2 - nose, 2 * math.pi))


def audited(out) -> dict:
    """What the chain of the flight says, validated from its first block on."""
    ledger = out / "run" / "ledger"
    done = subprocess.run([BIN / "ledgerline", "audit", "--blocks", ledger / "ledger" / "blocks", "--anchor", ledger / "teleop.block",
                           "--json", "-"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)["drones"]


def test_a_teleop_flies_drones_without_any_pose(tmp_path):
    """Two drones: the first one lands by its pilot's word, the second one's pilot and ground fall silent in the air."""
    mps, leg_s, turn_radps, turn_s, rest_s = 0.4, 2.0, 0.6, 2.6, 1.0
    outsider = Outsider()
    first, second = Teleop(outsider, "tello1"), Teleop(outsider, "tello2")
    flight = fly(tmp_path, "--shape", "manual", "--pose", "none", "--drones", "2", "--seconds", MAX_S)
    for pilot in (first, second):
        wait_for_states(pilot, tmp_path, flight)
    connect(first, second)
    for pilot in (first, second):
        pilot.take_off()
    for pilot in (first, second):
        pilot.wait("flying")

    done = {}  # what was asked for, and from when until it was at rest again
    for name, velocity in (("leg", {"forward": mps}), ("turn", {"turn": turn_radps}), ("second leg", {"forward": mps})):
        begin, end = first.fly(leg_s if "forward" in velocity else turn_s, **velocity)
        time.sleep(rest_s)
        done[name] = (begin, end + rest_s)
    silent_since = done["second leg"][1] - rest_s
    time.sleep(1)
    silent_until = time.monotonic()
    first.say("land")
    second.fly(0.5, forward=mps)
    first.wait("landing")

    # Ground stands still, so that nobody commands the hover: the plan in hand runs out, and 5 s of hold land it.
    ground, before = pid_of("ledgerline-ground"), len(second.transitions())
    stands_since = time.monotonic()
    try:
        subprocess.run(["kill", "-STOP", str(ground)], check=True)
        time.sleep(6.5)
    finally:
        subprocess.run(["kill", "-CONT", str(ground)], check=True)
    first.wait("landed")
    second.wait("landed", before)
    modes = [each[1:] for each in second.transitions()[before:]]
    assert first.odom.take() == second.odom.take() == [], "nobody said where they are"
    flight.send_signal(signal.SIGINT)
    assert flight.wait(60) == 1, printed(tmp_path)
    assert "tello2" in result(tmp_path)["why"] and "tello1" not in result(tmp_path)["why"], result(tmp_path)["why"]

    truth = Truth(tmp_path, 1)
    moved = {name: truth.moved(*when) for name, when in done.items()}
    print("; ".join(f"{name}: {ahead:.2f} m ahead, {left:.2f} m left, {turn:.2f} rad" for name, (ahead, left, turn) in moved.items()))
    for name in ("leg", "second leg"):
        ahead, left, turn = moved[name]
        assert 0.75 < ahead / (mps * leg_s) < 1.25 and abs(left) < 0.25 and abs(turn) < 0.2, (name, moved[name])
    assert 0.75 < moved["turn"][2] / (turn_radps * turn_s) < 1.25 and math.hypot(*moved["turn"][:2]) < 0.25, moved["turn"]
    assert truth.at(silent_since)[2] > 0.5, "in the air"
    assert math.dist(truth.at(silent_since + rest_s)[:2], truth.at(silent_until)[:2]) < 0.15, "who is silent leaves a drone that stands"
    assert truth.rows[-1][1][2] < 0.1, "landed"

    assert modes[0] == ("hold", "plan_ran_out") and ("land", "held_too_long") in modes, modes
    truth = Truth(tmp_path, 2)
    x, y, z, _ = truth.at(stands_since + 1)
    assert z > 0.5 and math.dist((x, y), truth.at(stands_since + 4)[:2]) < 0.2, "it holds where it was"
    down = next(t for t, row in truth.rows if t > stands_since and row[2] < 0.1) - stands_since
    print(f"without ground it is down after {down:.1f} s")
    assert 5 < down < 10, down

    reported = audited(tmp_path)
    for drone in (reported["tello1"], reported["tello2"]):
        assert drone["poses"] == 0 and drone["states"] > 100
        assert "take-off" in [word["what"] for word in drone["words"]], drone["words"]
        (commands,) = drone["commands"]
        assert commands["who"].startswith("Org2MSP/") and commands["valid"] > 50, commands
    assert "landing" in [word["what"] for word in reported["tello1"]["words"]]
    on_ledger = {each["id"]: each["commands"]["on_ledger"] for each in result(tmp_path)["drones"]}
    assert all(count > 50 for count in on_ledger.values()), on_ledger
    assert_nothing_left()


@contextlib.contextmanager
def poses_of(outsider: Outsider, name: str):
    """A motion capture system that sees a drone at rest, and may be switched off."""
    writer, off = outsider.writes(f"/vrpn_mocap/{name}/pose", PoseStamped), threading.Event()

    def see() -> None:
        while not off.wait(0.02):
            stamp_ns = time.time_ns()
            writer.say(PoseStamped(Header(Time(*divmod(stamp_ns, 10**9)), "map"), Pose(Vector3(), Quaternion(0.0, 0.0, 0.0, 1.0))))

    system = threading.Thread(target=see)
    system.start()
    try:
        yield off
    finally:
        off.set()
        system.join()


def test_where_the_config_does_not_let_a_pilot_do_without_a_pose_the_take_off_is_refused_aloud(tmp_path):
    """The default. Poses are there until the drones were looked over, and gone when the pilot wants to take off."""
    outsider = Outsider()
    pilot = Teleop(outsider, "tello1")
    file = deployment(tmp_path, POSES + SAFE + '[flight]\nshape = "manual"\n')
    with somebody_elses_drones(tmp_path, 1, "--mocap-hz", "0"), poses_of(outsider, "tello1") as off:
        flight = fly(tmp_path, "--deployment", file)
        wait_for_states(pilot, tmp_path, flight)
        off.set()
        connect(pilot)
        time.sleep(0.5)
        pilot.say("takeoff")
        log, refusal = tmp_path / "run" / "ground.log", "tello1: no take-off: link refuses it (its pose is lost; where its by_hand_without_pose"
        deadline = time.monotonic() + 30
        while refusal not in log.read_text():
            assert time.monotonic() < deadline, log.read_text()
            time.sleep(0.05)
        pilot.fly(0.5, forward=0.4)
        flight.send_signal(signal.SIGINT)
        assert flight.wait(60) == 0, printed(tmp_path)
    assert pilot.transitions() == [], "it stood there"
    assert json.loads((tmp_path / "sim.json").read_text())["drones"][0]["flew"] is False
    counts = json.loads((tmp_path / "run" / "ground.summary.json").read_text())["drones"][0]["pilot"]
    assert counts["refused"] == 1 and counts["velocities"] == 0 and counts["not_flying"] > 5, counts
    assert_nothing_left()
