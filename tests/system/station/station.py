"""A client of the ground station's API, as a page or a script is one."""
import contextlib
import json
import pathlib
import random
import re
import ssl
import subprocess
import time
import urllib.error
import urllib.request

from flights import printed
from websockets.sync.client import ClientConnection, connect

TIMEOUT_S = 60  # not a limit on speed: only how long a broken test may take


class Station:
    context: ssl.SSLContext | None = None  # where it has TLS

    def __init__(self, out: pathlib.Path, flight: subprocess.Popen) -> None:
        deadline = time.monotonic() + TIMEOUT_S
        while not (found := re.search(r"The page: (http://([\d.:]+))/#token=(\w+)", printed(out))):
            assert flight.poll() is None and time.monotonic() < deadline, printed(out)
            time.sleep(0.05)
        self.url, self.place, self.token = found.groups()

    def ask(self, method: str, path: str, body: object = None, headers: dict | None = None) -> tuple[int, dict]:
        """Status and what was answered."""
        request = urllib.request.Request(f"{self.url}/api/v1/{path}", method=method, headers={"Authorization": f"Bearer {self.token}", **(headers or {})},
                                         data=None if body is None else json.dumps(body).encode())
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_S, context=self.context) as response:
                return response.status, json.load(response)
        except urllib.error.HTTPError as refused:
            return refused.code, json.load(refused)

    def say(self, path: str, body: object = None) -> None:
        status, answer = self.ask("POST", path, body)
        assert status == 202, answer

    def drone(self, name: str) -> dict:
        return next(drone for drone in self.ask("GET", "drones")[1]["drones"] if drone["name"] == name)

    def path(self, name: str) -> list:
        return self.ask("GET", "paths")[1]["paths"][name]

    def wait(self, name: str, wanted) -> dict:
        """Until that holds of the drone."""
        deadline = time.monotonic() + TIMEOUT_S
        while not wanted(drone := self.drone(name)):
            assert time.monotonic() < deadline, drone
            time.sleep(0.05)
        return drone

    def stream(self, **options) -> ClientConnection:
        return connect(f"{self.url.replace('http', 'ws', 1)}/api/v1/stream",
                       **({"ssl": self.context, "subprotocols": ["ledgerline.v1", f"token.{self.token}"]} | options))


def is_ready(drone: dict) -> bool:
    """For a take-off. While a flight starts link still waits for the ledger, and refuses one."""
    return drone["link_phase"] in ("on_ground", "landed") and drone["position"] and drone["cause"] in ("none", "stopped") and not drone["stopped_by"]


def take_off(station: Station, name: str) -> None:
    station.wait(name, is_ready)
    station.say(f"drones/{name}/takeoff")
    station.wait(name, lambda drone: drone["phase"] == "manual")


def velocity(name: str, x: float, y: float = 0, yaw_rate: float = 0) -> str:
    now_ms = time.monotonic() * 1e3  # the ground's clock, as it runs on this host; elsewhere: t_ms of the newest state
    return json.dumps({"op": "velocity", "drone": name, "linear": [x, y, 0], "yaw_rate": yaw_rate, "t_ms": now_ms})


def client_hello(name: str) -> bytes:
    """The first message of a TLS handshake with `name`."""
    out = ssl.MemoryBIO()
    hello = ssl.create_default_context().wrap_bio(ssl.MemoryBIO(), out, server_hostname=name)
    with contextlib.suppress(ssl.SSLWantReadError):
        hello.do_handshake()
    return out.read()


def spoilt(draw: random.Random, good: bytes) -> bytes:
    """With some bytes that are others, and cut off somewhere."""
    bad = bytearray(good)
    for _ in range(draw.randint(1, 20)):
        bad[draw.randrange(len(bad))] = draw.randrange(256)
    return bytes(bad[:draw.randrange(1, len(bad) + 1)])
