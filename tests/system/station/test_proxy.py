"""The station behind nginx, by the configuration that docs/station.md has."""
import pathlib
import re
import shutil
import ssl
import subprocess
import time

import pytest
from flights import fly, no_flight_outlives_its_test
from netns import die_with_parent
from station import TIMEOUT_S, Station, take_off, velocity
from test_station import end
from test_tls import DOCS, make
from websockets.exceptions import InvalidStatus

NGINX = shutil.which("nginx", path=f"/usr/sbin:/usr/bin:{DOCS.parents[1]}/build/nginx/usr/sbin")
PAGE = "https://ground.example.org"
pytestmark = pytest.mark.skipif(NGINX is None, reason="no nginx (./run-tests --all unpacks it)")


class ProxiedStation(Station):
    """As a browser has it that opened the page through the proxy."""

    def __init__(self, direct: Station, made: pathlib.Path) -> None:
        self.url, self.token = "https://127.0.0.1", direct.token
        self.context = ssl.create_default_context(cafile=made / "page-ca.pem")

    def of_page(self, origin: str) -> tuple[int, dict]:
        return self.ask("POST", "drones/tello1/pause", headers={"Origin": origin})


@pytest.fixture
def station(tmp_path):
    """Through nginx, on port 443 of this test's own network."""
    made = make(tmp_path / "made", "DNS:ground.example.org,IP:127.0.0.1")
    flight = fly(tmp_path, "--drones", "1", "--shape", "manual", "--watch")
    direct = Station(tmp_path, flight)
    servers = re.search(r"```nginx\n(.*?)```", DOCS.read_text(), re.DOTALL)[1]
    servers = servers.replace("127.0.0.1:8800", direct.place).replace("/etc/ledgerline", str(made))
    paths = "".join(f"{kind}_temp_path {tmp_path}/{kind};" for kind in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    config = tmp_path / "nginx.conf"
    config.write_text(f"daemon off; user root; pid {tmp_path}/nginx.pid; events {{}} http {{ access_log off; {paths}\n{servers}}}\n")
    proxy = subprocess.Popen([NGINX, "-e", "stderr", "-c", config], preexec_fn=die_with_parent)
    proxied = ProxiedStation(direct, made)
    deadline = time.monotonic() + TIMEOUT_S
    while True:
        try:
            proxied.ask("GET", "drones")
            break
        except OSError:
            assert proxy.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
    yield proxied
    proxy.terminate()
    proxy.wait(TIMEOUT_S)
    end(flight, tmp_path)


def test_a_pilot_flies_through_it_and_another_site_s_page_is_refused(station):
    take_off(station, "tello1")
    assert station.of_page(PAGE)[0] == 202
    for other in ("https://evil.example", "http://ground.example.org", "https://ground.example.org.evil.example", "null"):
        assert station.of_page(other) == (403, {"error": "asked by a page of another site"}), other
    before = station.drone("tello1")["position"][0]
    with station.stream(origin=PAGE) as stream:
        deadline = time.monotonic() + TIMEOUT_S
        while station.drone("tello1")["position"][0] < before + 0.3:
            assert time.monotonic() < deadline
            stream.send(velocity("tello1", 0.4))
            stream.recv(TIMEOUT_S)
    with pytest.raises(InvalidStatus), station.stream(origin="https://evil.example"):
        pass
