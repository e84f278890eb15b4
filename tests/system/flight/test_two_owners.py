"""One operator's mission with drones of two organisations: a host each, whose network and shared memory are its own."""
import contextlib
import json
import os
import pathlib
import socket
import subprocess
import threading

import pytest
from fabric import BIN, needs_fabric
from ledgers import Embedded, Fabric, tables
from netns import Namespace

LONG = os.environ.get("LEDGERLINE_LONG") == "1"

PATIENCE_S = 120
OPERATOR = 2  # the organisation


class Way:
    """From 127.0.0.1:PORT of a namespace to the same place of ours."""

    def __init__(self, space: Namespace, port: int):
        self.port = port
        listening = threading.Thread(target=self.listen, args=(space,))  # setns is a thread's own
        listening.start()
        listening.join()
        threading.Thread(target=self.accept, daemon=True).start()

    def listen(self, space: Namespace) -> None:
        space.join()
        self.listener = socket.create_server(("127.0.0.1", self.port))

    def accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near = self.listener.accept()[0]
                far = socket.create_connection(("127.0.0.1", self.port))
                for one, other in ((near, far), (far, near)):
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    threading.Thread(target=self.carry, args=(one, other), daemon=True).start()

    @staticmethod
    def carry(one: socket.socket, other: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                other.sendall(data)
        with contextlib.suppress(OSError):
            other.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        self.listener.close()


def port_of(endpoint: str) -> int:
    return int(endpoint.rsplit(":", 1)[1])


class Host:
    """A drone host: RouDi, link and agent, and the simulator of its drone."""

    def __init__(self, directory: pathlib.Path, ledger, organisation: int, drone: str, number: int):
        self.directory = directory / f"host{organisation}"
        self.directory.mkdir()
        self.space = Namespace()
        ports = {port_of(ledger.peer(k)[0]) for k in (1, 2, 3)} | {port_of(ledger.orderer()[0])} | {
            port_of(ledger.endorser(k)[0]) for k in (1, 2, 3)}
        self.ways = [Way(self.space, port) for port in ports]
        this = f'[[drone]]\nname = "{drone}"\nnumber = {number}\n'
        output = lambda name: f'[output]\nsummary = "{self.directory}/{name}.json"\n'
        for name, text in (("sim", "[dds]\nlocal_only = true\n"),
                           ("link", f'{output("link")}[playout]\nmax_margin_ms = 0\n{this}address = "127.0.0.2"\n'),
                           ("agent", f'{tables(ledger, organisation, endorsers=True)}{output("agent")}[mocap]\n'
                                     f'topic = "/vrpn_mocap/tello1/pose"\n[dds]\nlocal_only = true\n{this}')):
            (self.directory / f"{name}.toml").write_text(text)
        start = lambda name, *words: f'{BIN}/ledgerline-{name} {" ".join(words)} > {self.directory}/{name}.log 2>&1 & all="$! $all"'
        # At the end in the other order: nobody ends well whose RouDi is gone.
        script = "\n".join([
            "all=",
            f"mount --bind {self.directory} /mnt", "mount -t tmpfs -o mode=1777 tmpfs /dev/shm", "mkdir /dev/shm/ledger",
            f"mount --rbind {ledger.directory} /dev/shm/ledger", "mount -t tmpfs -o mode=1777 tmpfs /tmp",
            f"mkdir -p {self.directory} {ledger.directory}", f"mount --bind /mnt {self.directory}",
            f"mount --rbind /dev/shm/ledger {ledger.directory}", f"cd {self.directory}",
            start("roudi"), "for i in $(seq 200); do grep -q ready roudi.log && break; sleep 0.1; done", start("sim", "--config", "sim.toml", "--drones", "1", "--summary", f"{self.directory}/sim.json"),
            start("link", "--config", "link.toml"), start("agent", "--config", "agent.toml"),
            "echo started", "read word || true", "for one in $all; do kill $one || true; wait $one || true; done"])
        # A process namespace, too: whatever ends the first process ends all.
        self.process = self.space.popen("unshare", "-m", "--pid", "--fork", "--kill-child", "--mount-proc", "sh", "-euc", script,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "started\n"

    def log(self) -> str:
        return "\n".join(f"{file}:\n{file.read_text()[-3000:]}" for file in sorted(self.directory.glob("*.log")))

    def stop(self) -> None:
        self.process.stdin.close()
        self.process.wait(60)
        for way in self.ways:
            way.close()
        self.space.close()


@pytest.fixture(params=["embedded", "fabric"] if LONG else ["fabric"])
def ledger(request, tmp_path):
    if request.param == "fabric":
        needs_fabric()
    made = Embedded(tmp_path / "ledger", "--batch-count", "1") if request.param == "embedded" else Fabric(tmp_path / "ledger")
    yield made
    made.stop()


def test_an_operator_flies_drones_of_two_other_organisations_in_one_mission(tmp_path, ledger):
    def control(organisation: int, user: str, *words) -> None:
        file = tmp_path / f"control{organisation}{user}.toml"
        file.write_text(tables(ledger, organisation, user, endorsers=True).split("[[msp]]")[0])
        done = subprocess.run([BIN / "ledgerline-control", "--config", file, *words], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr

    def cert(organisation: int) -> pathlib.Path:
        return next((ledger.msp_dir(organisation, "User1") / "signcerts").iterdir())

    drones = {1: "north", 3: "south"}
    for owner, drone in drones.items():
        control(owner, "Admin", "enroll", "--msp", f"Org{owner}MSP", "--cert", cert(owner), drone)
        control(owner, "Admin", "grant", "--msp", f"Org{OPERATOR}MSP", "--fly", "--max-priority", "10", drone)
    control(OPERATOR, "Admin", "enroll", "--msp", f"Org{OPERATOR}MSP", "--cert", cert(OPERATOR), "--role", "operator")
    control(OPERATOR, "User1", "acquire", *drones.values())  # of two owners in one transaction
    hosts = [Host(tmp_path, ledger, owner, drone, number) for number, (owner, drone) in enumerate(drones.items(), 1)]
    try:
        (tmp_path / "ground.toml").write_text(
            f'{tables(ledger, OPERATOR, endorsers=True)}[output]\nsummary = "{tmp_path}/ground.json"\nstatus_period_ms = 0\n'
            "[flight]\nlaps = 1\n[dds]\nlocal_only = true\n" +
            "".join(f'[[drone]]\nname = "{drone}"\n' for drone in drones.values()))
        flown = subprocess.run([BIN / "ledgerline-ground", "--config", tmp_path / "ground.toml"], capture_output=True,
                               text=True, timeout=PATIENCE_S)
        assert flown.returncode == 0, flown.stderr[-3000:] + "".join(host.log() for host in hosts)
    finally:
        for host in hosts:
            host.stop()
    ground = json.loads((tmp_path / "ground.json").read_text())
    assert all(drone["finished"] and drone["landed"] for drone in ground["drones"]), ground
    assert ground["transactions_altered"] == ground["states_unbelieved"] == 0
    print({key: ground["transactions"][key] for key in ("submitted", "committed", "invalidated")})
    for host in hosts:
        agent = json.loads((host.directory / "agent.json").read_text())
        commands = agent["drones"][0]["commands"]
        assert commands["on_ledger"] > 100 and commands["verified"] > 0.9 * commands["on_ledger"], commands
