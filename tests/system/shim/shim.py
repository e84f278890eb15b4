"""ledgerline-link and ledgerline hil shim, as a person starts them with a script of plans."""
import contextlib
import csv
import json
import os
import pathlib
import random
import subprocess
from typing import NamedTuple

from netns import die_with_parent
from trace_file import RECORD, Record, TraceKind, whole_records

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
TIMEOUT_S = 300  # not a limit on speed: only how long a broken test may take
SHARED_MEMORY = pathlib.Path("/dev/shm")  # of this run alone: scripts/isolated

SCRIPT = """
[[say]]          # until it has heard of the drone, a take-off is refused
at_s = 1
for_s = 4
what = "takeoff"
[[say]]
at_s = 6
for_s = 1.5
velocity_mps = [0.4, 0.1, 0]
yaw_rate_radps = 0.3
[[silence]]      # hold, and on
at_s = 8
for_s = 0.7
[[say]]
at_s = 7.5
for_s = 2.5
velocity_mps = [-0.3, 0, 0.1]
[[say]]
at_s = 10
for_s = 1
what = "land"
"""


def drawn_script(seed: int) -> str:
    """Take-off, some stretches with a silence in or between them, and a landing; of one or two drones."""
    draw = random.Random(seed)
    drones = draw.choice([1, 1, 2])
    script, at = [f"drones = {drones}", '[[say]]\nat_s = 1\nfor_s = 4\nwhat = "takeoff"'], 6.0
    for _ in range(draw.randint(2, 4)):
        lasts = draw.uniform(0.5, 2)
        which = draw.choice(["*", f"tello{drones}"])
        velocity = ", ".join(f"{draw.uniform(-0.4, 0.4):.2f}" for _ in range(2))
        script.append(f'[[say]]\nat_s = {at:.3f}\nfor_s = {lasts:.3f}\ndrone = "{which}"\nvelocity_mps = [{velocity}, 0]\n'
                      f"yaw_rate_radps = {draw.uniform(-0.5, 0.5):.2f}")
        at += lasts + draw.choice([0, 0, 0.3, 0.9, 1.4])
    script.append(f"[[silence]]\nat_s = {draw.uniform(6.5, at):.3f}\nfor_s = {draw.choice([0.2, 0.5, 1.0])}")
    script.append(f'[[say]]\nat_s = {at + 0.5:.3f}\nfor_s = 1\nwhat = "land"\n')
    return "\n".join(script)


class Flown(NamedTuple):
    summary: dict
    reported: list  # (seconds, drone, text)
    link: dict
    records: list

    def transitions(self, drone: str) -> list:
        return [(t["phase"], t["mode"], t["cause"]) for t in self.summary["transitions"] if t["drone"] == drone]

    def setpoints(self) -> dict:
        """When each plan's each setpoint left, in seconds since the script began."""
        begin = self.summary["begin_ns"]
        first = {}
        for r in self.records:
            if r.kind == TraceKind.SETPOINT_SENT:
                first.setdefault((r.drone, r.id), (r.t_ns - begin) * 1e-9)
        return first


def link_config(directory: pathlib.Path, drones: int, memory: pathlib.Path | None, lockstep: bool) -> pathlib.Path:
    tables = "".join(f'[[drone]]\nname = "tello{k}"\naddress = "127.0.0.{k + 1}"\n' for k in range(1, drones + 1))
    shim = f'[tello]\ntransport = "shim"\n[shim]\nmemory = "{memory}"\nlockstep = {str(lockstep).lower()}\n' if memory else ""
    config = directory / "link.toml"
    config.write_text(f'{tables}{shim}[state]\nlisten = "127.0.0.1:8890"\n[playout]\nmax_margin_ms = 0\n[output]\n'
                      f'trace = "{directory}/link.trace"\nsummary = "{directory}/link.json"\n')
    return config


@contextlib.contextmanager
def running(log: pathlib.Path, *command):
    process = subprocess.Popen([str(word) for word in command], stdout=subprocess.PIPE, stderr=open(log, "wb"), text=True,
                               preexec_fn=die_with_parent)
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        process.stdout.close()


def ready(process, log: pathlib.Path) -> None:
    line = process.stdout.readline()
    assert '"ready":true' in line, line + log.read_text()


def fly(directory: pathlib.Path, script: str, *options: str, udp: bool = False, lockstep: str = "", meanwhile=None) -> Flown:
    """`meanwhile`: is called with hil and link once both run."""
    directory.mkdir()
    plans = directory / "plans.toml"
    plans.write_text(script)
    drones = int(script.split("drones = ")[1].split()[0]) if "drones = " in script else 1
    memory = None if udp else SHARED_MEMORY / f"{directory.name}.shim"
    where = ["--udp", "127.0.0.2"] if udp else ["--memory", memory]
    if lockstep:
        where += ["--lockstep", lockstep]
    hil_log, link_log = directory / "hil.log", directory / "link.log"
    config = link_config(directory, drones, memory, bool(lockstep))
    with contextlib.ExitStack() as stack:
        if not lockstep:
            log = directory / "roudi.log"
            ready(stack.enter_context(running(log, BIN / "ledgerline-roudi")), log)
        hil = stack.enter_context(running(hil_log, BIN / "ledgerline", "hil", "shim", *where, "--plans", plans, "--seed", 5,
                                          "--datagrams", directory / "sent.csv", "--summary", directory / "hil.json", *options))
        ready(hil, hil_log)
        link = stack.enter_context(running(link_log, BIN / "ledgerline-link", "--config", config))
        if meanwhile:
            meanwhile(hil, link)
        assert hil.wait(TIMEOUT_S) == 0, hil_log.read_text()
        if not lockstep:  # in lockstep it ends with its clock
            link.terminate()
        assert link.wait(TIMEOUT_S) == 0, link_log.read_text()
    with open(directory / "sent.csv") as file:
        reported = [(float(row["seconds"]), row["drone"], row["text"]) for row in csv.DictReader(file)]
    records = [Record(*r) for r in RECORD.iter_unpack(whole_records(directory / "link.trace"))]
    return Flown(json.loads((directory / "hil.json").read_text()), reported, json.loads((directory / "link.json").read_text()), records)
