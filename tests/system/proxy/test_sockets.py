"""What goes through the proxy, seen from both of its ends: a made-up drone and a made-up server."""
import socket
import stat
import subprocess
import threading
import time

import pytest

from proxies import BIN, HIL, TIMEOUT_S, Proxy
from running import cpu_s

DRONE, FRONT, SOURCE = "127.0.0.2", "127.0.1.2", "127.0.2.1"


def udp(address: str, port: int) -> socket.socket:
    s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    s.bind((address, port))
    s.settimeout(10)
    return s


def quiet(s: socket.socket, seconds: float = 0.1) -> bool:
    s.settimeout(seconds)
    try:
        s.recvfrom(2048)
        return False
    except TimeoutError:
        return True
    finally:
        s.settimeout(10)


def test_commands_answers_state_and_video_find_their_way(proxies):
    proxy = proxies(drones=[("tello1", FRONT, DRONE)], source=SOURCE)
    drone = udp(DRONE, 8889)
    pilot, onlooker = udp("127.0.0.10", 40000), udp("127.0.0.11", 40001)
    state, video = udp("127.0.0.10", 8890), udp("127.0.0.10", 11111)
    drone.sendto(b"early", (SOURCE, 8890))  # nobody has said `command` yet
    pilot.sendto(b"command", (FRONT, 8889))
    said, to_pilot = drone.recvfrom(2048)
    assert said == b"command" and to_pilot[0] == SOURCE
    onlooker.sendto(b"battery?", (FRONT, 8889))
    said, to_onlooker = drone.recvfrom(2048)
    assert said == b"battery?" and to_onlooker != to_pilot, "each client has a way of its own"
    drone.sendto(b"87", to_onlooker)
    drone.sendto(b"ok", to_pilot)
    assert onlooker.recvfrom(2048) == (b"87", (FRONT, 8889))
    assert pilot.recvfrom(2048) == (b"ok", (FRONT, 8889))
    drone.sendto(b"bat:87;", (SOURCE, 8890))
    drone.sendto(bytes(1460), (SOURCE, 11111))
    assert state.recvfrom(2048) == (b"bat:87;", (FRONT, 8889))
    assert video.recvfrom(2048) == (bytes(1460), (FRONT, 8889))
    udp("127.0.0.12", 0).sendto(b"bat:1;", (SOURCE, 8890))  # an outsider
    assert quiet(state)
    pilot.sendto(b"port 8890 9000", (FRONT, 8889))
    assert pilot.recvfrom(2048)[0] == b"error" and quiet(drone)
    summary = proxy.end()
    one = summary["drones"][0]
    assert (one["clients"], one["nobody"], one["ports_refused"], summary["outsiders"]) == (2, 1, 1, 1)
    assert [one[way]["went"] for way in ("to", "answers", "state", "video")] == [2, 3, 1, 1]


def test_each_direction_is_impaired_by_itself_live_and_by_script(proxies):
    proxy = proxies(drones=[("tello1", FRONT, DRONE)], source=SOURCE,
                    script='[[fault]]\nat_s = 0\nfor_s = 1\ndo = "drone tello1 to delay 300ms"\n')
    drone, pilot, state = udp(DRONE, 8889), udp("127.0.0.10", 40000), udp("127.0.0.10", 8890)

    def ways_ms() -> tuple[float, float, bytes]:
        begin = time.monotonic()
        pilot.sendto(b"command", (FRONT, 8889))
        _, back = drone.recvfrom(2048)
        there = time.monotonic()
        drone.sendto(b"ok", back)
        answer = pilot.recvfrom(2048)[0]
        return 1e3 * (there - begin), 1e3 * (time.monotonic() - there), answer

    to, back, _ = ways_ms()
    assert to > 299 and back < 299
    time.sleep(1)
    proxy.tell("drone tello1 answers delay 350ms, corrupt 100%")
    assert proxy.tell("list") == "drone tello1 answers delay 350ms, corrupt 100%\n"
    to, back, answer = ways_ms()
    assert to < 299 and back > 349 and answer != b"ok" and len(answer) == 2
    proxy.tell("clear")
    proxy.tell("drone * state partition")
    drone.sendto(b"bat:87;", (SOURCE, 8890))
    assert quiet(state)
    proxy.tell("drone tello1 state partition off")
    proxy.tell("drone tello1 both stall")
    drone.sendto(b"bat:86;", (SOURCE, 8890))
    assert quiet(state)
    proxy.tell("drone tello1 both stall off")
    assert state.recvfrom(2048)[0] == b"bat:86;"
    summary = proxy.end()
    one = summary["drones"][0]
    assert one["state"]["lost"] == 1 and one["answers"]["corrupted"] == 1
    assert [s["command"] for s in summary["switched"]][:2] == ["drone tello1 to delay 300ms", "drone tello1 to delay off"]
    times = [s["t_ns"] for s in summary["switched"]]
    assert times == sorted(times) and abs(times[1] - times[0] - 1e9) < 50e6


def test_a_ninth_client_is_refused_and_a_flood_is_bounded(proxies):
    proxy = proxies(drones=[("tello1", FRONT, DRONE)], source=SOURCE)
    drone = udp(DRONE, 8889)
    clients = [udp("127.0.0.10", 0) for _ in range(9)]
    for client in clients:
        client.sendto(b"battery?", (FRONT, 8889))
        time.sleep(0.01)
    seen = {drone.recvfrom(2048)[1] for _ in range(8)}
    assert len(seen) == 8 and quiet(drone)
    proxy.tell("drone tello1 to stall")
    for _ in range(6_000):
        clients[0].sendto(b"rc 0 0 0 0", (FRONT, 8889))
    clients[0].sendto(b"rc 0 0 0 0", (FRONT, 8889))
    time.sleep(0.2)
    one = proxy.end()["drones"][0]
    assert one["too_many_clients"] == 1
    assert one["to"]["waiting"] <= 4096 and one["to"]["came"] == 8 + one["to"]["waiting"] + one["to"]["no_room"]


class Server:
    """Gives back what it gets, until it is asked to end."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1:%d" % self.listener.getsockname()[1]
        self.taken = []
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            self.taken.append(connection)
            threading.Thread(target=self.echo, args=(connection,), daemon=True).start()

    @staticmethod
    def echo(connection):
        try:
            while data := connection.recv(65536):
                connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
        except OSError:
            pass


@pytest.fixture
def server():
    made = Server()
    yield made
    made.listener.close()


def connect(proxy: Proxy, name: str = "node") -> socket.socket:
    host, port = proxy.servers[name].split(":")
    connection = socket.create_connection((host, int(port)), timeout=TIMEOUT_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return connection


def receive(connection: socket.socket, size: int) -> bytes:
    got = b""
    while len(got) < size:
        data = connection.recv(min(65536, size - len(got)))
        if not data:
            break
        got += data
    return got


def test_a_stream_comes_whole_under_delay_jitter_and_rate_and_ends_where_it_ended(proxies, server):
    proxy = proxies(servers=[("node", "127.0.0.1:0", server.address)])
    content = bytes(range(256)) * 12_000  # 3 MB: more than a link holds
    for effects in ("clear", "delay 20ms, jitter uniform 0ms 20ms", "rate 20MB/s queue 64kB"):
        proxy.tell(f"server node both {effects}")
        connection = connect(proxy)
        sender = threading.Thread(target=lambda: (connection.sendall(content), connection.shutdown(socket.SHUT_WR)))
        sender.start()
        assert receive(connection, len(content) + 1) == content, effects
        sender.join()
        connection.close()
    summary = proxy.end()["servers"][0]
    assert summary["connections"] == 3 and summary["resets"] == 0 and summary["open"] == 0
    assert summary["to"] == summary["from"] == {"bytes_in": 3 * len(content), "bytes_out": 3 * len(content)}


def test_a_stream_is_delayed_stalled_held_back_and_cut_as_reported(proxies, server):
    proxy = proxies(servers=[("node", "127.0.0.1:0", server.address)])
    connection = connect(proxy)

    def turn_s() -> float:
        begin = time.monotonic()
        connection.sendall(b"x")
        assert receive(connection, 1) == b"x"
        return time.monotonic() - begin

    assert turn_s() < 0.19
    proxy.tell("server node both delay 100ms")
    assert 0.2 <= turn_s() < 1
    proxy.tell("server node both clear")
    proxy.tell("server node from stall")
    connection.sendall(b"y")
    connection.settimeout(0.2)
    with pytest.raises(TimeoutError):
        connection.recv(1)
    connection.settimeout(TIMEOUT_S)
    proxy.tell("server node from stall off")
    assert receive(connection, 1) == b"y"
    proxy.tell("server node to partition")
    other = connect(proxy)  # the kernel answers; the server hears nothing of it
    other.sendall(b"z")
    time.sleep(0.1)
    assert len(server.taken) == 1
    proxy.tell("server node to partition off")
    assert receive(other, 1) == b"z"
    proxy.tell("server node cut")
    for one in (connection, other):
        with pytest.raises(ConnectionResetError):
            one.recv(1)
    connection = connect(proxy)
    assert turn_s() < 0.19
    assert proxy.end()["servers"][0]["cut"] == 2


def test_who_is_slow_or_gone_is_felt_on_the_other_side_and_nothing_is_unbounded(proxies, server):
    with socket.create_server(("127.0.0.1", 0)) as gone:
        nobody = "127.0.0.1:%d" % gone.getsockname()[1]
    proxy = proxies(servers=[("node", "127.0.0.1:0", server.address), ("nobody", "127.0.0.1:0", nobody)])
    with pytest.raises(ConnectionResetError):
        connect(proxy, "nobody").recv(1)
    slow = connect(proxy)
    slow.settimeout(1)
    sent = 0
    with pytest.raises(TimeoutError):  # the echo is not read: it backs up through proxy, server and proxy
        while True:
            sent += slow.send(bytes(65536))
    assert sent < 64e6
    for process in (proxy.process.pid,):
        status = open(f"/proc/{process}/status").read()
        assert int(status.split("VmRSS:")[1].split()[0]) < 64_000, "kB"
    many = [connect(proxy) for _ in range(63)]
    for one in many:
        one.sendall(b"x")
        assert receive(one, 1) == b"x"
    with pytest.raises(ConnectionResetError):
        connect(proxy).recv(1)
    used = cpu_s(proxy.process.pid)
    time.sleep(1)
    assert cpu_s(proxy.process.pid) - used < 0.5, "it waits in a loop"
    summary = {s["name"]: s for s in proxy.end()["servers"]}
    assert summary["nobody"]["unreached"] == 1 and summary["node"]["too_many"] == 1 and summary["node"]["open"] == 64


def refused(directory, config: str, script: str = "") -> tuple[int, str]:
    (directory / "c.toml").write_text(config)
    (directory / "s.toml").write_text(script)
    done = subprocess.run([*HIL, "proxy", "--config", directory / "c.toml", *(["--script", directory / "s.toml"] if script else [])],
                          capture_output=True, text=True, timeout=TIMEOUT_S)
    return done.returncode, done.stderr


def test_what_is_not_possible_is_refused_with_the_reason(proxies, tmp_path):
    drone = f'[[drone]]\nname = "tello1"\nlisten = "{FRONT}"\naddress = "{DRONE}"\n'
    node = '[[server]]\nname = "node"\nlisten = "127.0.0.1:0"\naddress = "127.0.0.1:7051"\n'
    for fault, why in (("server node to loss 5%", "loss is of datagrams"), ("drone tello1 cut", "no connection"),
                       ("drone tello2 to stall", "there are tello1"), ("server node answers stall", "a server has")):
        code, said = refused(tmp_path, drone + node, f'[[fault]]\nat_s = 1\ndo = "{fault}"\n')
        assert code == 2 and why in said and "s.toml:3" in said, said
    assert refused(tmp_path, "")[0] == 2
    assert refused(tmp_path, drone + "surprise = 1\n")[0] == 2
    proxy = proxies(drones=[("tello1", FRONT, DRONE)], source=SOURCE)
    assert stat.S_IMODE(proxy.socket.stat().st_mode) == 0o600
    for command, why in (("drone tello1 to lag 1s", "allowed are delay"), ("drone tello1 to rate 5", "is not from 1B/s")):
        done = subprocess.run([*HIL, "faults", proxy.socket, command], capture_output=True, text=True, timeout=TIMEOUT_S)
        assert done.returncode == 1 and why in done.stderr
    assert proxy.tell("list") == ""
    code, said = refused(tmp_path, drone)
    assert code == 1 and f"another proxy holds {FRONT}:8889" in said
    done = subprocess.run([*HIL, "faults", tmp_path / "none.sock", "list"], capture_output=True, text=True, timeout=TIMEOUT_S)
    assert done.returncode == 1 and "does not answer" in done.stderr
    assert subprocess.run([BIN / "ledgerline", "hil", "proxy"], capture_output=True, timeout=TIMEOUT_S).returncode == 2
    assert proxy.end()["switched"] == []
