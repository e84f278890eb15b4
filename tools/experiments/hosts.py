"""A flight on three hosts: network namespaces for the drones, the ledger and the ground, with nothing but cables between them,
or the proxy of hil as the Wi-Fi of the drones' host and of the ground."""
import pathlib
import subprocess
import sys
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))
import running
from netns import Namespace, connect
from running import Failed

LEDGER, DRONES, GROUND = "10.77.0.2", "10.77.0.1", "10.77.0.3"
PORT = 7051
READY_S, END_S = 30, 20
SIDE_M, HEIGHT_M = 1.5, 1.0  # as fly has them


class Program(running.Program):
    def __init__(self, space: Namespace, name: str, command: list, directory: pathlib.Path):
        super().__init__(space.popen, command, directory / f"{name}.log", "ab")
        self.name = name

    def wait_ready(self) -> "Program":
        super().wait_ready(READY_S)
        return self

    def end(self) -> None:
        super().end(END_S)


def configs(run: pathlib.Path, endpoints: dict, options: dict) -> dict[str, str]:
    """By program, as fly writes them (tools/launcher/configs.cpp)."""
    crypto = run / "ledger/crypto/peerOrganizations"
    organisation = lambda k: crypto / f"org{k}.ledgerline"

    def ledger(endpoint: str, k: int, user: str) -> str:
        # The certificate speaks of localhost, whatever the address.
        return (f'[ledger]\nendpoint = "{endpoint}"\nserver_name = "localhost"\n'
                f'tls_ca = "{organisation(1)}/tlsca/tlsca.org1.ledgerline-cert.pem"\nmsp_id = "Org{k}MSP"\n'
                f'msp_dir = "{organisation(k)}/users/{user}@org{k}.ledgerline/msp"\n\n')

    msps = "".join(f'[[msp]]\nid = "Org{k}MSP"\nca = "{organisation(k)}/ca/ca.org{k}.ledgerline-cert.pem"\n\n'
                   for k in (1, 2, 3))
    output = lambda name: f'[output]\ntrace = "{run}/{name}.trace"\nsummary = "{run}/{name}.summary.json"\n\n'
    drone = '[[drone]]\nname = "tello1"\nnumber = 1\n'
    return {
        "link": output("link") + f"[state]\nrate_hz = {options['rate']}\n\n[playout]\nmax_margin_ms = 0\n\n" + drone +
                'address = "127.0.0.2"\n',
        "agent": ledger(endpoints["drones"], 1, "User1") + msps + output("agent") + drone,
        "ground": ledger(endpoints["ground"], 2, "User1") + msps + output("ground") +
                  f'[flight]\nshape = "{options["shape"]}"\nspeed_mps = {options["speed"]}\nlaps = {options["laps"]}\n'
                  f"height_m = {HEIGHT_M}\nside_m = {SIDE_M}\n\n" + drone,
        "admin": ledger(endpoints["drones"], 1, "Admin"),
        "operator": ledger(endpoints["ground"], 2, "User1")}


def proxy_files(run: pathlib.Path, host: str, wifi: str, seed: int) -> list:
    """The proxy's config and script on one host: all that it says to the ledger and hears from it goes that way."""
    config, script = run / f"proxy-{host}.toml", run / f"proxy-{host}-script.toml"
    config.write_text(f'[proxy]\nseed = {seed}\n\n[[server]]\nname = "ledger"\nlisten = "127.0.0.1:{PORT}"\n'
                      f'address = "{LEDGER}:{PORT}"\n')
    script.write_text(f'[[fault]]\nat_s = 0\ndo = "server ledger both {wifi}"\n')
    return ["--config", config, "--script", script]


def fly(program, run: pathlib.Path, options: dict, seed: int, limit_s: float) -> bool:
    """`program` gives the words that start a program, by its name. True when ground says that the path was finished."""
    run.mkdir(parents=True)
    started = []

    def start(space: Namespace, name: str, *words, ready: bool = True) -> Program:
        one = Program(space, name, [*program(name.split("-")[0]), *words], run)
        started.append(one)
        return one.wait_ready() if ready else one

    def to_end(space: Namespace, name: str, *words) -> None:
        one = start(space, name, *words, ready=False)
        try:
            code = one.process.wait(READY_S)
        except subprocess.TimeoutExpired:
            one.fail(f"did not end within {READY_S} s")
        if code != 0:
            one.fail("failed")

    spaces = []
    try:
        ledger, drones, ground = (spaces.append(Namespace()) or spaces[-1] for _ in range(3))
        connect(ledger, LEDGER, drones, DRONES, "to-drones")
        connect(ledger, LEDGER, ground, GROUND, "to-ground")
        start(ledger, "node", "--dir", run / "ledger", "--listen", f"{LEDGER}:{PORT}", "--summary", run / "node.summary.json")
        endpoints = {"drones": f"{LEDGER}:{PORT}", "ground": f"{LEDGER}:{PORT}"}
        if options.get("wifi"):
            for host, space in (("drones", drones), ("ground", ground)):
                start(space, f"hil-{host}", "proxy", *proxy_files(run, host, options["wifi"], seed))
                endpoints[host] = f"127.0.0.1:{PORT}"
        for name, text in configs(run, endpoints, options).items():
            (run / f"{name}.toml").write_text(text)
        start(drones, "roudi", "--summary", run / "roudi.summary.json")
        start(drones, "sim", "--seed", seed, "--trace", run / "sim.trace", "--summary", run / "sim.summary.json")
        user = run / "ledger/crypto/peerOrganizations/org1.ledgerline/users/User1@org1.ledgerline"
        certificate = next((user / "msp/signcerts").iterdir())
        to_end(drones, "control-enroll", "--config", run / "admin.toml", "enroll", "--msp", "Org1MSP", "--cert", certificate,
               "tello1")
        to_end(ground, "control-acquire", "--config", run / "operator.toml", "acquire", "tello1")
        for space, name in ((drones, "link"), (drones, "agent"), (ground, "ground")):
            start(space, name, "--config", run / f"{name}.toml")
        pilot = started[-1].process
        until = time.monotonic() + limit_s
        while pilot.poll() is None and time.monotonic() < until:
            for one in started:
                if not one.name.startswith(("control", "ground")) and one.process.poll() is not None:
                    one.fail("ended in flight")
            time.sleep(0.1)
        return pilot.poll() == 0
    finally:
        for one in reversed(started):
            one.end()
        for space in spaces:
            space.close()
