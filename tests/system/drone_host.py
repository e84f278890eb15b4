"""A drone host as a test's own machine."""
import contextlib
import pathlib
import socket
import subprocess
import threading
import typing

from fabric import BIN
from netns import Namespace


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
                try:
                    far = socket.create_connection(("127.0.0.1", self.port))
                except ConnectionRefusedError:  # nobody is there for now
                    near.close()
                    continue
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


def ports_of(ledger) -> set[int]:
    places = [ledger.orderer()[0], *(where(k)[0] for where in (ledger.peer, ledger.endorser) for k in (1, 2, 3))]
    return {port_of(place) for place in places}


class Drone(typing.NamedTuple):
    name: str
    number: int
    channel: str = ""  # empty: that of [ledger]


class Host:
    """A drone host: RouDi, link and agent, and the simulator of its drones; its network and shared memory are its own."""

    def __init__(self, directory: pathlib.Path, ledgers: list, tables: str, drones: list[Drone], pose: str = "{drone}"):
        """`tables`: where the ledger is, for agent. `pose`: the name that motion capture has for a drone."""
        self.directory = directory
        self.directory.mkdir()
        self.space = Namespace()
        self.ways = [Way(self.space, port) for port in set().union(*map(ports_of, ledgers))]
        output = lambda name: f'[output]\nsummary = "{self.directory}/{name}.json"\n'
        named = [f'[[drone]]\nname = "{drone.name}"\nnumber = {drone.number}\n' for drone in drones]
        link = "".join(f'{text}address = "127.0.0.{k}"\n' for k, text in enumerate(named, 2))
        agent = "".join(text + (f'channel = "{drone.channel}"\n' if drone.channel else "")
                        for text, drone in zip(named, drones))
        for name, text in (("sim", "[dds]\nlocal_only = true\n"),
                           ("link", f'{output("link")}status_period_ms = 200\n[playout]\nmax_margin_ms = 0\n{link}'),
                           ("agent", f'{tables}{output("agent")}[mocap]\n'
                                     f'topic = "/vrpn_mocap/{pose}/pose"\n[dds]\nlocal_only = true\n{agent}')):
            (self.directory / f"{name}.toml").write_text(text)
        start = lambda name, *words: f'{BIN}/ledgerline-{name} {" ".join(words)} > {self.directory}/{name}.log 2>&1 & all="$! $all"'
        # At the end in the other order: nobody ends well whose RouDi is gone.
        script = "\n".join([
            "all=",
            f"mount --bind {self.directory} /mnt", "mount -t tmpfs -o mode=1777 tmpfs /dev/shm",
            *(f"mkdir /dev/shm/ledger{k}; mount --rbind {each.directory} /dev/shm/ledger{k}" for k, each in enumerate(ledgers)),
            "mount -t tmpfs -o mode=1777 tmpfs /tmp", f"mkdir -p {self.directory}", f"mount --bind /mnt {self.directory}",
            *(f"mkdir -p {each.directory}; mount --rbind /dev/shm/ledger{k} {each.directory}" for k, each in enumerate(ledgers)),
            f"cd {self.directory}",
            start("roudi"), "for i in $(seq 200); do grep -q ready roudi.log && break; sleep 0.1; done", start("sim", "--config", "sim.toml", "--drones", str(len(drones)), "--summary", f"{self.directory}/sim.json"),
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
