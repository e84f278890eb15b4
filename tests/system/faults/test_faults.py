"""Parts of a Fabric network are killed under load: traffic goes on by itself, and nothing that was confirmed is lost or twice."""
import json
import os
import pathlib
import random
import re
import signal
import subprocess
import time
import urllib.request

from fabric import FABRIC, needs_fabric

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
LONG = os.environ.get("LEDGERLINE_LONG") == "1"
KINDS = ["leader", "orderer", "peer", "gateway peer", "chaincode"]
PATIENCE_S = 120  # not a limit on speed: only how long a broken test may take


class Network:
    def __init__(self, directory: pathlib.Path):
        self.directory = directory
        self.summary = directory.with_suffix(".json")
        self.log = directory.with_suffix(".log")
        self.process = subprocess.Popen(
            [BIN / "ledgerline-fabric", "run", "--dir", directory, "--tools", FABRIC, "--orderers", "3", "--summary", self.summary],
            stdout=subprocess.PIPE, stderr=open(self.log, "ab"), text=True)
        ready = self.process.stdout.readline()
        assert ready, self.log.read_text()
        self.ready = json.loads(ready)

    def processes(self) -> dict[str, dict]:
        done = subprocess.run([BIN / "ledgerline-fabric", "status", "--dir", self.directory], capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + self.log.read_text()
        return {process["name"]: process for process in json.loads(done.stdout)["processes"]}

    def leader(self) -> str:
        """As the orderers' own metrics have it; there may be none for a moment."""
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            for name, process in self.processes().items():
                if "operations" not in process or process["pid"] == 0:
                    continue
                try:
                    with urllib.request.urlopen(f"http://{process['operations']}/metrics", timeout=5) as answer:
                        if re.search(rb'consensus_etcdraft_is_leader\{channel="teleop"\} 1', answer.read()):
                            return name
                except OSError:
                    pass  # it is just starting
            time.sleep(0.1)
        raise AssertionError("no orderer leads")

    def victim(self, kind: str) -> str:
        if kind == "leader":
            return self.leader()
        if kind == "orderer":
            return random.choice([f"orderer{k}" for k in (1, 2, 3) if f"orderer{k}" != self.leader()])
        return {"peer": random.choice(["peer2", "peer3"]), "gateway peer": "peer1", "chaincode": "chaincode1"}[kind]

    def client_config(self, path: pathlib.Path, organisation: int) -> pathlib.Path:
        """Org1's drone host, at a peer of an organisation, on the direct path."""
        crypto = self.directory / "crypto"
        org = lambda k: crypto / "peerOrganizations" / f"org{k}.ledgerline"
        text = (f'[ledger]\nendpoint = "{self.ready["peers"][organisation - 1]}"\n'
                f'tls_ca = "{org(organisation)}/tlsca/tlsca.org{organisation}.ledgerline-cert.pem"\n'
                f'msp_id = "Org1MSP"\nmsp_dir = "{org(1)}/users/User1@org1.ledgerline/msp"\n')
        for orderer in self.ready["orderers"]:
            text += (f'[[orderer]]\nendpoint = "{orderer}"\n'
                     f'tls_ca = "{crypto}/ordererOrganizations/ledgerline/tlsca/tlsca.ledgerline-cert.pem"\n')
        path.write_text(text)
        return path

    def stop(self) -> None:
        self.process.terminate()
        assert self.process.wait(timeout=PATIENCE_S) == 0, self.log.read_text()


class Load:
    def __init__(self, network: Network, directory: pathlib.Path):
        configs = [network.client_config(directory / f"peer{k}.toml", k) for k in (1, 2, 3)]
        self.process = subprocess.Popen(
            [BIN / "fault_load", "--config", configs[0], *(word for config in configs for word in ("--peer", config))],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert json.loads(self.process.stdout.readline())["ready"]

    def ask(self, command: str) -> dict:
        self.process.stdin.write(command + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        assert line, f"the load ended with {self.process.wait()}"
        return json.loads(line)

    def wait_for_traffic(self, transactions: int) -> dict:
        """Until so many transactions that were sent after the mark are committed."""
        deadline = time.monotonic() + PATIENCE_S
        while (seen := self.ask("watch"))["committed"] < transactions:
            assert time.monotonic() < deadline, f"no traffic: {seen}"
            time.sleep(0.05)
        return seen


def test_what_was_confirmed_stays_and_nothing_is_applied_twice(tmp_path):
    needs_fabric()
    random.seed(5)
    network = Network(tmp_path / "net")
    load = Load(network, tmp_path)
    load.wait_for_traffic(50)
    gaps: dict[str, list[float]] = {kind: [] for kind in KINDS}
    kinds = KINDS * (20 if LONG else 1)
    if LONG:
        random.shuffle(kinds)
    for kind in kinds:
        name = network.victim(kind)
        before = network.processes()[name]
        load.ask("mark")
        os.kill(before["pid"], signal.SIGKILL)
        deadline = time.monotonic() + PATIENCE_S
        while (now := network.processes()[name])["restarts"] == before["restarts"] or now["pid"] == 0:
            assert time.monotonic() < deadline, f"{name} does not come back"
            time.sleep(0.05)
        sent = load.ask("watch")["committed"]
        seen = load.wait_for_traffic(sent + 50)
        gaps[kind].append(seen["gap_ms"] / 1e3)
        print(f"{kind:13} {name:11} {gaps[kind][-1]:6.2f} s without a commit, {seen['block_gap_ms'] / 1e3:6.2f} s without a block"
              f"{'; ' + seen['problem'] if seen['problem'] else ''}", flush=True)
    verdict = load.ask("end")
    network.stop()
    for kind, seconds in gaps.items():
        print(f"{kind:13} {len(seconds)} faults, gap median {sorted(seconds)[len(seconds) // 2]:.2f} s, longest {max(seconds):.2f} s")
    print(json.dumps(verdict, indent=1))
    assert verdict["peers"] == 3 and verdict["problems"] == []
    assert verdict["committed"] >= 50 * len(kinds)
    assert verdict["sent"] == sum(verdict[kind] for kind in ("committed", "open", "refused", "invalidated"))
    for wrong in ("missing", "twice", "refused_but_applied", "states_that_differ"):
        assert verdict[wrong] == 0, wrong
    restarts = json.loads(network.summary.read_text())["restarts"]
    assert sum(restarts.values()) == len(kinds)
