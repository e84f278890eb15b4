"""A capture of a Tello's link becomes a table, and the proxy plays it as its day went on."""
import pathlib
import socket
import struct
import subprocess
import time

from proxies import HIL, TIMEOUT_S, Proxy
from test_sockets import DRONE, FRONT, SOURCE, quiet, udp

DRONE_OF_CAPTURE, CLIENT_OF_CAPTURE = "192.168.10.1", "192.168.10.2"


def datagram(payload: bytes) -> bytes:
    """A state text from port 8889 to 8890, as a bare IP packet."""
    udp_header = struct.pack("!HHHH", 8889, 8890, 8 + len(payload), 0)
    addresses = socket.inet_aton(DRONE_OF_CAPTURE) + socket.inet_aton(CLIENT_OF_CAPTURE)
    return struct.pack("!BBHHHBBH", 0x45, 0, 28 + len(payload), 0, 0, 64, socket.IPPROTO_UDP, 0) + addresses + udp_header + payload


def write_capture(path: pathlib.Path, arrivals_ms: list[float]) -> None:
    raw_ip = 101
    with path.open("wb") as file:
        file.write(struct.pack("=IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, raw_ip))
        for at in arrivals_ms:
            packet = datagram(b"pitch:0;h:0;tof:10;bat:87;\r\n")
            us = round(at * 1000)
            file.write(struct.pack("=IIII", 1_790_000_000 + us // 1_000_000, us % 1_000_000, len(packet), len(packet)) + packet)


def day_of(*words) -> subprocess.CompletedProcess:
    return subprocess.run([*HIL, "day", *words], capture_output=True, text=True, timeout=TIMEOUT_S)


def test_a_capture_becomes_a_table(tmp_path):
    capture = tmp_path / "flight.pcap"
    write_capture(capture, [k * 100 + (20 if k % 5 == 1 else 0) for k in range(50) if k not in (20, 21)])
    made = day_of(capture)
    assert made.returncode == 0, made.stderr
    rows = made.stdout.splitlines()
    assert rows[0].startswith(f"# states of {DRONE_OF_CAPTURE}: 48 came, 2 missing, one every 100.0")
    assert rows[1:4] == ["seconds,delay_s", "0.000000,0.000000", "0.100000,0.020000"]
    assert [row for row in rows if row.endswith("lost")] == ["1.950000,lost", "2.050000,lost"]

    refused = day_of(capture, "--drone", "10.0.0.1")
    assert refused.returncode == 1 and f"{DRONE_OF_CAPTURE} (48 states)" in refused.stderr
    assert "answered at once" in day_of(capture, "--of", "answers").stderr
    capture.write_bytes(capture.read_bytes()[:-7])
    damaged = day_of(capture)
    assert damaged.returncode == 1 and "flight.pcap: damaged behind 47 packets" in damaged.stderr


def test_the_proxy_plays_a_day(proxies, tmp_path):
    proxy: Proxy = proxies(drones=[("tello1", FRONT, DRONE)], source=SOURCE)
    drone, pilot, state = udp(DRONE, 8889), udp("127.0.0.10", 40000), udp("127.0.0.10", 8890)
    pilot.sendto(b"command", (FRONT, 8889))
    drone.recvfrom(2048)
    day = tmp_path / "day.csv"
    day.write_text("seconds,delay_s\n0,0.3\n1000,0.3\n2000,lost\n3000,0\n")
    proxy.tell(f"drone tello1 state recorded-day {day}")
    begin = time.monotonic()
    drone.sendto(b"bat:87;", (SOURCE, 8890))
    assert state.recvfrom(2048)[0] == b"bat:87;"
    assert 0.29 < time.monotonic() - begin < 5
    proxy.tell(f"drone tello1 state recorded-day {day} at 2010s")
    drone.sendto(b"bat:86;", (SOURCE, 8890))
    assert quiet(state)
    assert proxy.end()["drones"][0]["state"]["lost"] == 1
