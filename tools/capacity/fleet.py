"""A fleet on several hosts of one machine: drone hosts in network namespaces at a bridge, ledger and ground beside it."""
import contextlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))
import running
from netns import Namespace, die_with_parent
from running import TICKS_PER_S, Failed

STATION = "10.78.0.1"  # of ledger and ground
READY_S, END_S = 120, 90
GROUND_STARTS = 5   # one that ends before it is ready is begun again, as its systemd unit does
NAMES_A_HOST = 16   # host k has tello<16 k + 1> and so on, whether it has that many or not
# Whose drones a host flies: organisation and user. The first is the ledger's own drone host.
HOSTS = ((1, "User1"), (1, "User2"), (1, "Admin"), (3, "User1"))
OPERATOR = (2, "User1")


class Program(running.Program):
    """`drones` and `streams`: how many it serves; a stream is what one drone host has on one channel."""

    def __init__(self, kind: str, command: list, log: pathlib.Path, drones: int, streams: int):
        super().__init__(lambda *words, **to: subprocess.Popen(words, preexec_fn=die_with_parent, **to), list(map(str, command)), log)
        self.kind, self.drones, self.streams = kind, drones, streams

    def wait_ready(self) -> dict:
        return super().wait_ready(READY_S)

    def newest(self) -> dict:
        """The last whole line of status."""
        return next(reversed(self.lines()), {})

    def end(self) -> int | None:
        return super().end(END_S)


class DroneHost:
    """A network and a shared memory of its own."""

    def __init__(self, number: int, keep: list[pathlib.Path]):
        self.space = Namespace()
        pid, name = self.space.holder.pid, f"host{number}"
        subprocess.run(["ip", "link", "add", name, "type", "veth", "peer", "name", "eth0", "netns", str(pid)], check=True)
        subprocess.run(["ip", "link", "set", name, "master", "fleet", "up"], check=True)
        self.space.run("ip", "addr", "add", f"10.78.0.{number + 10}/24", "dev", "eth0")
        self.space.run("ip", "link", "set", "eth0", "up")
        # RouDi's files are in /dev/shm and /tmp. What is needed of /tmp comes back by way of /mnt.
        below_tmp = [path for path in keep if path.is_relative_to("/tmp")]
        script = "\n".join(
            ["mount -t tmpfs tmpfs /mnt", *(f"mkdir /mnt/{i}; mount --rbind {path} /mnt/{i}" for i, path in enumerate(below_tmp)),
             "mount -t tmpfs -o mode=1777 tmpfs /dev/shm", "mount -t tmpfs -o mode=1777 tmpfs /tmp",
             *(f"mkdir -p {path}; mount --rbind /mnt/{i} {path}" for i, path in enumerate(below_tmp)),
             "echo mounted", "exec sleep infinity"])
        self.mounts = self.space.popen("unshare", "-m", "sh", "-euc", script, stdout=subprocess.PIPE, text=True)
        if self.mounts.stdout.readline() != "mounted\n":
            raise Failed("a drone host got no /dev/shm and /tmp of its own: run through scripts/isolated")

    def command(self, *words) -> list:
        return self.space.command("nsenter", f"--mount=/proc/{self.mounts.pid}/ns/mnt", *words)

    def close(self) -> None:
        self.mounts.kill()
        self.mounts.wait()
        self.mounts.stdout.close()
        self.space.close()


class Drone:
    def __init__(self, host: int, place: int, channel: int):
        self.host, self.place, self.channel = host, place, channel
        self.name = f"tello{host * NAMES_A_HOST + place}"


def spread(drones: int, hosts: int) -> list[int]:
    """How many each host has."""
    return [drones // hosts + (k < drones % hosts) for k in range(hosts)]


class Fleet:
    """Everything that flies `drones_of_hosts` on `channels`, drone by drone on the next channel; a ground for each list of
    hosts in `grounds`. `fabric`: the folder with Fabric's programs; none: the embedded node, one for each channel."""

    def __init__(self, programs: pathlib.Path, run: pathlib.Path, drones_of_hosts: list[int], channels: int = 1,
                 grounds: list[list[int]] | None = None, fabric: pathlib.Path | None = None, rate_hz: float = 30,
                 traces: bool = False, grounds_may_end: bool = False):
        self.programs, self.run, self.fabric, self.rate_hz, self.traces = programs, run, fabric, rate_hz, traces
        self.grounds_may_end = grounds_may_end
        self.names = ["teleop", *(f"teleop{k}" for k in range(2, channels + 1))]
        total = iter(range(sum(drones_of_hosts)))
        self.drones = [Drone(host, place, next(total) % channels)
                       for host, count in enumerate(drones_of_hosts) for place in range(1, count + 1)]
        self.hosts_count = len(drones_of_hosts)
        self.grounds_of = grounds or [list(range(self.hosts_count))]
        self.running, self.hosts, self.bridge = [], [], False
        self.agents, self.links, self.grounds, self.ground_restarts = [], [], [], 0

    # Who is where.
    def of(self, hosts: list[int]) -> list[Drone]:
        return [drone for drone in self.drones if drone.host in hosts]

    def streams(self, drones: list[Drone]) -> int:
        return len({(drone.host, drone.channel) for drone in drones})

    # What the programs get.
    def organisation(self, k: int) -> pathlib.Path:
        return self.run / f"ledger/crypto/peerOrganizations/org{k}.ledgerline"

    def tables(self, who: tuple[int, str], channels: list[int], trusted: bool = True) -> str:
        """Where the ledger is, and whom to trust, for somebody on these channels."""
        organisation, user = who
        if self.fabric:
            own, ca = self.ready["peers"][organisation - 1], self.tls_ca(organisation)
        text = ""
        for i, channel in enumerate(channels):
            name = self.names[channel]
            block = self.run / ("ledger" if self.fabric or channel == 0 else name) / f"{name}.block"
            if not self.fabric:
                own, ca = f"{STATION}:{7051 + channel}", self.tls_ca(1)
            text += (f'[ledger]\nchannel = "{name}"\n' if i == 0 else f'[[channel]]\nname = "{name}"\n')
            text += f'config_block = "{block}"\n'
            if i == 0 or not self.fabric:
                text += f'endpoint = "{own}"\ntls_ca = "{ca}"\n' + ('' if self.fabric else 'server_name = "localhost"\n')
            if i == 0:
                text += (f'msp_id = "Org{organisation}MSP"\n'
                         f'msp_dir = "{self.organisation(organisation)}/users/{user}@org{organisation}.ledgerline/msp"\n')
        if self.fabric:
            orderer_ca = self.run / "ledger/crypto/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem"
            text += f'[[orderer]]\nendpoint = "{self.ready["orderers"][0]}"\ntls_ca = "{orderer_ca}"\n'
            text += "".join(f'[[endorser]]\nmsp_id = "Org{k}MSP"\nendpoint = "{self.ready["peers"][k - 1]}"\ntls_ca = "{self.tls_ca(k)}"\n'
                            for k in (1, 2, 3))
        if trusted:
            text += "".join(f'[[msp]]\nid = "Org{k}MSP"\nca = "{self.organisation(k)}/ca/ca.org{k}.ledgerline-cert.pem"\n'
                            for k in (1, 2, 3))
        return text

    def tls_ca(self, k: int) -> pathlib.Path:
        return self.organisation(k) / f"tlsca/tlsca.org{k}.ledgerline-cert.pem"

    def output(self, name: str) -> str:
        trace = f'trace = "{self.run}/{name}.trace"\n' if self.traces else ""
        return f'[output]\n{trace}summary = "{self.run}/{name}.json"\n'

    def drone_tables(self, drones: list[Drone], first_channel: int | None = None, link: bool = False) -> str:
        text = ""
        for place, drone in enumerate(drones, 1):
            text += f'[[drone]]\nname = "{drone.name}"\nnumber = {place}\n'
            if link:
                text += f'address = "127.0.0.{place + 1}"\n'
            elif drone.channel != first_channel:
                text += f'channel = "{self.names[drone.channel]}"\n'
        return text

    def write(self, name: str, text: str) -> pathlib.Path:
        file = self.run / f"{name}.toml"
        file.write_text(text)
        return file

    # Starting and ending.
    def start_program(self, kind: str, name: str, words: list, drones: list[Drone], host: DroneHost | None = None) -> Program:
        command = [self.programs / "ledgerline", "fabric", *words] if kind == "fabric" else [self.programs / f"ledgerline-{kind}", *words]
        if not command[0].exists():
            raise Failed(f"{command[0].name} is not built: ninja -C build/release programs")
        one = Program(kind, host.command(*command) if host else command, self.run / f"{name}.log", len(drones), self.streams(drones))
        self.running.append(one)
        return one

    def start(self) -> "Fleet":
        self.run.mkdir(parents=True)
        for words in ("link add fleet type bridge", f"addr add {STATION}/24 dev fleet", "link set fleet up"):
            subprocess.run(["ip", *words.split()], check=True)
            self.bridge = True
        self.start_ledger()
        self.give_rights()
        for k in range(self.hosts_count):
            self.start_host(k)
        for one in self.agents:
            one.wait_ready()
        for k, hosts in enumerate(self.grounds_of):
            self.start_ground(k, self.of(hosts))
        return self

    def start_ledger(self) -> None:
        if self.fabric:
            places = self.write("net", "batch_count = 1\n" + "".join(f'[[organisation]]\nhost = "{STATION}"\nport = {7051 + 10 * k}\n' for k in range(3)) +
                                f'[[orderer]]\nhost = "{STATION}"\nport = 7151\n')
            words = [word for name in self.names for word in ("--channel", name)]
            one = self.start_program("fabric", "fabric", ["run", "--dir", self.run / "ledger", "--tools", self.fabric, "--config", places, *words], self.drones)
            self.ready = one.wait_ready()
            return
        for k, name in enumerate(self.names):
            place = self.run / ("ledger" if k == 0 else name)
            if k > 0:
                shutil.copytree(self.run / "ledger/crypto", place / "crypto")
            self.start_program("node", f"node{k}", ["--dir", place, "--listen", f"{STATION}:{7051 + k}", "--channel", name, "--batch-count", "1",
                                                    "--summary", self.run / f"node{k}.json"],
                               [drone for drone in self.drones if drone.channel == k]).wait_ready()

    def control(self, who: tuple[int, str], channel: int, *words, limit_s: float = READY_S) -> str:
        file = self.write(f"control-{who[0]}-{who[1]}-{channel}", self.tables(who, [channel], trusted=False))
        done = subprocess.run([self.programs / "ledgerline", "control", "--config", file, *words], capture_output=True, text=True, timeout=limit_s)
        if done.returncode != 0:
            raise Failed(f"control {' '.join(map(str, words))}: {done.stderr.strip()}")
        return done.stdout

    def give_rights(self) -> None:
        """Each host its drones, and the operator all of them."""
        for channel in range(len(self.names)):
            on_it = [drone for drone in self.drones if drone.channel == channel]
            for host in sorted({drone.host for drone in on_it} - {0}):
                organisation, user = HOSTS[host]
                named = [drone.name for drone in on_it if drone.host == host]
                msp = self.organisation(organisation) / f"users/{user}@org{organisation}.ledgerline/msp"
                self.control((organisation, "Admin"), channel, "enroll", "--msp", f"Org{organisation}MSP", "--cert",
                             next((msp / "signcerts").iterdir()), *named)
                self.control((organisation, "Admin"), channel, "grant", "--msp", f"Org{OPERATOR[0]}MSP", "--fly", "--max-priority", "10", *named)
            for hosts in self.grounds_of:
                if named := [drone.name for drone in on_it if drone.host in hosts]:
                    self.control(OPERATOR, channel, "acquire", *named)

    def start_host(self, k: int) -> None:
        drones = self.of([k])
        host = DroneHost(k, [self.run, self.programs.parent])
        self.hosts.append(host)
        channels = sorted({drone.channel for drone in drones})
        local = "[dds]\nlocal_only = true\n"
        sim = self.write(f"sim{k}", local)
        link = self.write(f"link{k}", self.output(f"link{k}") + f"[state]\nrate_hz = {self.rate_hz}\n[playout]\nmax_margin_ms = 0\n" +
                          self.drone_tables(drones, link=True))
        agent = self.write(f"agent{k}", self.tables(HOSTS[k], channels) + self.output(f"agent{k}") + local +
                           self.drone_tables(drones, channels[0]))
        self.start_program("roudi", f"roudi{k}", [], drones, host).wait_ready()
        self.start_program("sim", f"sim{k}", ["--config", sim, "--drones", len(drones), "--first-name", k * NAMES_A_HOST + 1, "--seed", k + 1,
                                              "--summary", self.run / f"sim{k}.json"], drones, host).wait_ready()
        self.links.append(self.start_program("link", f"link{k}", ["--config", link], drones, host))
        self.links[-1].wait_ready()
        self.agents.append(self.start_program("agent", f"agent{k}", ["--config", agent], drones, host))

    def start_ground(self, k: int, drones: list[Drone]) -> None:
        channels = sorted({drone.channel for drone in drones})
        file = self.write(f"ground{k}", self.tables(OPERATOR, channels) + self.output(f"ground{k}") +
                          '[flight]\nshape = "square"\nlaps = 10000\n[dds]\nlocal_only = true\n' + self.drone_tables(drones, channels[0]))
        for left in reversed(range(GROUND_STARTS)):
            one = self.start_program("ground", f"ground{k}", ["--config", file], drones)
            try:
                one.wait_ready()
                break
            except Failed:
                self.running.remove(one)
                if left == 0 or one.end() is None:
                    raise
                self.ground_restarts += 1
        self.grounds.append(one)

    def phases(self) -> dict[str, str]:
        """By drone, as the grounds say."""
        return {drone["name"]: drone["phase"] for ground in self.grounds for drone in drones_in(ground.newest())}

    def wait_flying(self, how_many: int, limit_s: float) -> int:
        """Until so many are on their path; how many are."""
        until = time.monotonic() + limit_s
        while True:
            self.check()
            flying = list(self.phases().values()).count("path")
            if flying >= how_many or time.monotonic() > until:
                return flying
            time.sleep(0.2)

    def check(self) -> None:
        """A ground all of whose drones the failsafe has landed is at its end, with 1."""
        for one in self.running:
            code = one.process.poll()
            if code is not None and not (self.grounds_may_end and one in self.grounds and code == 1):
                one.fail(f"ended with {one.process.returncode} in flight")

    def end(self) -> dict[str, int | None]:
        """The exit codes by name. Ground lands its drones first."""
        codes = {}
        for one in [*self.grounds, *(one for one in reversed(self.running) if one not in self.grounds)]:
            codes[one.log.stem] = one.end()
        for host in self.hosts:
            host.close()
        if self.bridge:
            subprocess.run(["ip", "link", "del", "fleet"], check=True)
        self.running, self.hosts, self.bridge = [], [], False
        return codes

    def processes(self) -> list[tuple[str, int, int, int]]:
        """Kind, process, drones and streams of each that runs, those that a program started among them."""
        found = []
        for one in self.running:
            if one.process.poll() is not None:
                continue
            found.append((one.kind, one.process.pid, one.drones, one.streams))
            found += [(kind, pid, one.drones, one.streams) for pid, kind in descendants(one.process.pid)]
        return found


def drones_in(status: dict) -> list[dict]:
    return next((value["drones"] for value in status.values() if isinstance(value, dict) and "drones" in value), status.get("drones", []))


def descendants(pid: int) -> list[tuple[int, str]]:
    found = []
    for task in pathlib.Path(f"/proc/{pid}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in map(int, task.read_text().split()):
                found += [(child, pathlib.Path(os.readlink(f"/proc/{child}/exe")).name.removeprefix("ledgerline-")), *descendants(child)]
    return found


def memory_mb(pid: int) -> float:
    """Resident."""
    return int(pathlib.Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def busy_s() -> float:
    """Of all cores of the machine: neither idle nor waiting for a disk, and not stolen."""
    user, nice, system, _, _, interrupts, soft = map(int, pathlib.Path("/proc/stat").read_text().splitlines()[0].split()[1:8])
    return (user + nice + system + interrupts + soft) / TICKS_PER_S


def summaries(one: Program) -> list[dict]:
    """Of each channel of an agent, after its end."""
    read = json.loads(one.log.with_suffix(".json").read_text())
    return read.get("channels", [read])
