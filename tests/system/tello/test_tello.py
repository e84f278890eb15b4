"""`ledgerline tello` against simulated Tellos: who is there, what it is, join a Wi-Fi, and down."""
import contextlib
import json
import math
import os
import pathlib
import signal
import socket
import subprocess
import time
import tomllib

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
EXAMPLES = pathlib.Path(__file__).resolve().parents[3] / "docs/examples"
LONG = os.environ.get("LEDGERLINE_LONG") == "1"


@contextlib.contextmanager
def drones(count: int = 1, *more: str, mocap: bool = False):
    """Simulated ones at 127.0.0.2 and up."""
    sim = subprocess.Popen([BIN / "ledgerline-sim", "--drones", str(count), "--mocap-hz", "100" if mocap else "0", *more],
                           stdout=subprocess.PIPE, text=True)
    try:
        assert '"ready":true' in sim.stdout.readline()
        yield
    finally:
        sim.terminate()
        sim.wait(20)


def tello(*words: str, **options) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / "ledgerline", "tello", *words], capture_output=True, text=True, timeout=60, **options)


def test_all_of_a_subnet_are_found_with_what_they_say():
    with drones(3):
        found = tello("find", "--subnet", "127.0.0.0/28", "--json")
        assert found.returncode == 0, found.stderr
        listed = json.loads(found.stdout)["drones"]
        assert [(d["address"], d["serial"]) for d in listed] == [(f"127.0.0.{k + 1}", f"0TQDG00SIM000{k}") for k in (1, 2, 3)]
        assert all(d["battery"] > 90 and d["sdk"] == "20" and d["hardware"] == "TELLO" for d in listed)
        assert all(d["version"] is None and d["wifi_version"] == "wifiv1.0.0.0" for d in listed)
        shown = tello("info", "127.0.0.3")
        assert shown.returncode == 0 and "0TQDG00SIM0002" in shown.stdout and "127.0.0.2" not in shown.stdout


def test_no_drone_found_is_reported():
    for words in (("find", "--address", "127.0.0.9"), ("info", "127.0.0.9")):
        shown = tello(*words)
        assert (shown.returncode, shown.stdout) == (1, "") and "no Tello answers" in shown.stderr
    assert json.loads(tello("find", "--address", "127.0.0.9", "--json").stdout) == {"drones": []}
    for words in (("find", "--subnet", "10.0.0.0/8"), ("info", "tello.local"), ("info",), ("calibrate-nothing",), ()):
        assert tello(*words).returncode == 2, words
    missing = tello("find", "--interface", "wlan77")
    assert missing.returncode == 1 and "wlan77" in missing.stderr


def test_a_password_comes_from_a_file_or_from_the_input_and_never_from_the_line(tmp_path):
    secret = tmp_path / "wifi"
    secret.write_text("correcthorse\n")
    with drones():
        joined = tello("join-wifi", "lab", "--password-file", str(secret), "--address", "127.0.0.2")
        assert joined.returncode == 0 and "lab" in joined.stdout and "find" in joined.stdout, joined.stderr
        typed = tello("join-wifi", "lab", "--address", "127.0.0.2", input="correcthorse\n")
        assert typed.returncode == 0
        for shown in (joined, typed):
            assert "correcthorse" not in shown.stdout + shown.stderr
        short = tello("join-wifi", "lab", "--address", "127.0.0.2", input="short\n")
        assert short.returncode == 2 and "8 to 63" in short.stderr
    assert tello("join-wifi", "lab", "correcthorse").returncode == 2
    assert tello("join-wifi", "lab", "--address", "127.0.0.9", input="correcthorse\n").returncode == 1


def test_a_tello_that_cannot_join_a_wifi_is_reported():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
        plain.bind(("127.0.0.2", 8889))
        plain.settimeout(10)
        asking = subprocess.Popen([BIN / "ledgerline", "tello", "join-wifi", "lab", "--address", "127.0.0.2"], text=True,
                                  stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        asking.stdin.write("correcthorse\n")
        asking.stdin.flush()
        _, client = plain.recvfrom(1024)
        plain.sendto(b"ok", client)
        word, client = plain.recvfrom(1024)
        assert word == b"ap lab correcthorse"
        plain.sendto(b"unknown command: ap", client)
        _, errors = asking.communicate(timeout=20)
    assert asking.returncode == 1 and "EDU" in errors


def test_a_drone_in_the_air_is_landed(tmp_path):
    summary = tmp_path / "sim.json"
    with drones(1, "--summary", str(summary)), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as pilot:
        pilot.settimeout(20)
        for word in (b"command", b"takeoff"):
            pilot.sendto(word, ("127.0.0.2", 8889))
            assert pilot.recv(100) == b"ok"
        pilot.sendto(b"rc 0 30 0 0", ("127.0.0.2", 8889))
        time.sleep(0.5)
        down = tello("land", "127.0.0.2")
        assert down.returncode == 0 and "is down" in down.stdout, down.stderr
        # Once more, for one that stands already.
        assert tello("land", "127.0.0.2").returncode == 0
    assert json.loads(summary.read_text())["drones"][0]["landed"]


def test_a_landing_without_a_drone_times_out_and_is_reported():
    begun = time.monotonic()
    down = tello("land", "127.0.0.9", "--seconds", "2")
    assert down.returncode == 1 and "does not answer" in down.stderr
    assert time.monotonic() - begun < 10


def test_bytes_of_any_kind_end_nothing_and_reach_no_terminal():
    noise = [b"", b"\x00" * 10, b"\xff\xfe\xfd", b"\x1b[2Jok", b"A" * 1400, b"battery?", b"okok", b"\x1b]0;x\x07"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as liar:
        liar.bind(("127.0.0.2", 8889))
        liar.settimeout(0.05)
        asking = subprocess.Popen([BIN / "ledgerline", "tello", "find", "--address", "127.0.0.2"], text=True,
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        while asking.poll() is None:
            with contextlib.suppress(TimeoutError):
                word, client = liar.recvfrom(1024)
                for answer in ([b"ok"] if word == b"command" else noise):
                    liar.sendto(answer, client)
        shown, errors = asking.communicate()
    assert asking.returncode == 0, errors
    assert "does not say" in shown and all(c == "\n" or " " <= c <= "~" for c in shown + errors)


def test_preflight_says_what_would_keep_a_flight_on_the_ground(tmp_path):
    file = tmp_path / "real.toml"
    file.write_text('[pose]\nsource = "tello"\nvelocity_signs = [1, -1, -1]\n[fence]\nmin_m = [-3, -3, 0]\nmax_m = [3, 3, 2]\n'
                    '[[drone]]\nname = "a"\naddress = "127.0.0.2"\nserial = "0TQDG00SIM0001"\n'
                    '[[drone]]\nname = "b"\naddress = "127.0.0.3"\nserial = "0TQDG00SIM0009"\nstart_m = [1, 0, 0]\n')
    words = ("preflight", "--deployment", str(file), "--seconds", "1.5")
    with drones(2):
        impatient = tmp_path / "impatient.toml"
        impatient.write_text(file.read_text() + "[flight]\nwait_s = 4\n")
        flight = subprocess.run([BIN / "ledgerline", "fly", "--deployment", impatient, "--out", tmp_path / "run"],
                                capture_output=True, text=True, timeout=60)
        assert flight.returncode == 1, flight.stderr
        assert "127.0.0.3 says serial 0TQDG00SIM0002, not 0TQDG00SIM0009" in flight.stderr, "fly says what preflight says"
        other = tello(*words)
        assert other.returncode == 1 and "127.0.0.3 says serial 0TQDG00SIM0002, not 0TQDG00SIM0009" in other.stdout
        assert "cure: `ledgerline tello find` shows where each is" in other.stdout, other.stdout
        file.write_text(file.read_text().replace("SIM0009", "SIM0002"))
        well = tello(*words)
        assert well.returncode == 0 and ", 0 broken" in well.stdout, well.stdout + well.stderr
        assert "by onboard odometry (tello): 1.00, 0.00, 0.00 m" in well.stdout
        example = (EXAMPLES / "deployment-odometry.toml").read_text()
        for named, here in (('"192.168.10.1"', '"127.0.0.2"'), ("\ncalibration =", "\n# calibration ="),
                            ('source = "tello"', 'source = "tello"\nvelocity_signs = [1, -1, -1]')):
            assert named in example
            example = example.replace(named, here)
        of_page = tmp_path / "of_page.toml"
        of_page.write_text(example)
        shown = tello("preflight", "--deployment", str(of_page), "--seconds", "1.5", "--json")
        assert shown.returncode == 0 and "odometry_short" not in shown.stdout, shown.stdout
        file.write_text(file.read_text() + "[flight]\nside_m = 6\n")
        beyond = tello(*words)
        assert beyond.returncode == 1 and "a would be at 6, 0, 1 m, beyond link's fence" in beyond.stdout
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as another:
            another.bind(("0.0.0.0", 8890))
            taken = tello(*words)
            assert (taken.returncode, taken.stdout) == (1, "") and "8890" in taken.stderr
    file.write_text(file.read_text().replace("velocity_signs", "# velocity_signs"))
    without_signs = tello(*words)
    assert without_signs.returncode == 2 and "pose.velocity_signs" in without_signs.stderr, "as the flight would be refused"
    file.write_text("[fence]\n")
    broken = tello(*words)
    assert broken.returncode == 2 and "pose.source" in broken.stderr
    assert tello("preflight").returncode == 2


def test_a_flight_measures_a_drone_and_lands_it_however_it_ends(tmp_path):
    written = tmp_path / "calibration.toml"
    with drones(1, "--yaw", "40", mocap=True):
        refused = tello("calibrate", "127.0.0.2", "--out", str(written), input="no\n")
        assert refused.returncode == 1 and "4 m x 4 m" in refused.stdout and not written.exists()
        ended = subprocess.Popen([BIN / "ledgerline", "tello", "calibrate", "127.0.0.2", "--yes", "--out", str(written)],
                                 stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        time.sleep(8)
        ended.send_signal(signal.SIGINT)
        said = ended.communicate(timeout=40)[0]
        assert ended.returncode == 1 and "asked to end" in said and not written.exists()
        if LONG:  # in real time: a minute
            flown = subprocess.run([BIN / "ledgerline", "tello", "calibrate", "127.0.0.2", "--yes", "--repeat", "1", "--mocap",
                                    "/vrpn_mocap/tello1/pose", "--out", str(written)], capture_output=True, text=True, timeout=150)
            assert flown.returncode == 0, flown.stderr
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as plain:
                plain.connect(("127.0.0.2", 8889))
                plain.settimeout(5)
                plain.send(b"height?")
                assert plain.recv(100) in (b"0dm", b"0dm\r\n")
    if LONG:
        measured = tomllib.loads(written.read_text())
        assert abs(measured["rc"]["full_scale_mps"] - 1) < 0.1 and measured["rc"]["signs"] == [-1, 1, 1, -1]
        assert abs(measured["rc"]["full_scale_radps"] - math.radians(100)) < 0.1
        assert measured["pose"] == {"velocity_signs": [1, 1, 1], "velocity_frame": "power_on"}
        assert measured["flight"]["full_scale_mps"] == measured["rc"]["full_scale_mps"] and 0.1 < measured["flight"]["lag_s"] < 0.5
    assert tello("calibrate").returncode == 2
    nobody = tello("calibrate", "127.0.0.9", "--yes", "--out", str(written))
    assert nobody.returncode == 1 and "does not answer" in nobody.stderr
