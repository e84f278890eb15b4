"""Walks docs/three-machines.md: its blocks, on three network namespaces as its hosts.

LEDGERLINE_INSTALLED names a Debian root with all packages installed: each host is then a root of its own on top of it, with the
packages that the page gives it, and the commands run there as they stand on the page. Without it the build's programs run, and
folders of the test stand for /etc/ledgerline and /var/lib.
"""
import functools
import os
import pathlib
import re
import subprocess

import findings
from netns import Namespace
from running import Program

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
PAGE = pathlib.Path(__file__).resolve().parents[3] / "docs/three-machines.md"
HOSTS = {"raven": "10.77.0.1", "tower": "10.77.0.2", "ground": "10.77.0.3"}
READY_S, END_S, STEP_S = 60, 20, 180
INSTALLED = os.environ.get("LEDGERLINE_INSTALLED")
# What the page does not give a host. dpkg refuses to take away what another package needs.
WITHOUT = {"raven": [], "tower": ["tools", "onboard", "dev"], "ground": ["tools", "onboard", "ledger", "dev"]}

SCP = """#!/bin/sh
# Between the hosts' homes and this host's files.
set -eu
[ "$1" != -r ] || shift
from=$1 to=$2
case $from in *:*) from=$ROOT/${from%%:*}/home/${from#*:} ;; esac
case $to in *:*) to=$ROOT/${to%%:*}/home/${to#*:} ;; esac
exec cp -r "$from" "$to"
"""


def blocks() -> list[tuple[str, bool, str]]:
    """(host, keeps running, commands) in the page's order."""
    out = []
    for text in re.findall(r"```sh\n(.*?)```", PAGE.read_text(), re.S):
        first, commands = text.split("\n", 1)
        host, keeps = re.fullmatch(r"# (\w+)( &)?", first).groups()
        out.append((host, keeps is not None, commands))
    return out


class Machines:
    def __init__(self, root: pathlib.Path) -> None:
        self.root = root
        self.running: list[Program] = []
        self.spaces = {host: Namespace() for host in HOSTS}
        ip = lambda *words: subprocess.run(["ip", *words], check=True)
        ip("link", "add", "machines", "type", "bridge")
        ip("link", "set", "machines", "up")
        deployment = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.S).group(1)
        (root / "bin").mkdir()
        (root / "bin/scp").write_text(SCP)
        (root / "bin/scp").chmod(0o755)
        for host, address in HOSTS.items():
            space = self.spaces[host]
            ip("link", "add", host, "type", "veth", "peer", "name", "eth0", "netns", str(space.holder.pid))
            ip("link", "set", host, "master", "machines", "up")
            space.run("ip", "addr", "add", f"{address}/24", "dev", "eth0")
            space.run("ip", "link", "set", "eth0", "up")
            for folder in ("home", "etc", "var"):
                (root / host / folder).mkdir(parents=True)
            (root / host / "home/deployment.toml").write_text(deployment)
        for host in HOSTS if INSTALLED else ():
            self.install(host)

    def install(self, host: str) -> None:
        """A root of its own, with /dev/shm and /tmp of its own; the hosts' homes are where they are outside, for scp alone."""
        here, mounted = self.root / host, self.root / host / "root"
        mount = lambda *words: subprocess.run(["mount", *map(str, words)], check=True)
        for folder in ("changes", "work", "root"):
            (here / folder).mkdir()
        mount("-t", "overlay", "-o", f"lowerdir={INSTALLED},upperdir={here}/changes,workdir={here}/work", "overlay", mounted)
        mount("-t", "proc", "proc", mounted / "proc")
        mount("--rbind", "/dev", mounted / "dev")
        mount("-t", "tmpfs", "-o", "mode=1777,size=512m", "tmpfs", mounted / "dev/shm")
        mount("-t", "tmpfs", "-o", "mode=1777", "tmpfs", mounted / "tmp")
        for folder in [self.root / other / "home" for other in HOSTS] + [self.root / "bin"]:
            inside = mounted / folder.relative_to("/")
            inside.mkdir(parents=True)
            mount("--bind", folder, inside)
        unwanted = [f"ledgerline-{part}" for part in WITHOUT[host]]
        if unwanted:
            subprocess.run(["chroot", mounted, "env", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "dpkg", "--remove", *unwanted],
                           check=True, stdout=subprocess.DEVNULL)

    def etc(self, host: str) -> pathlib.Path:
        return self.root / host / ("root/etc/ledgerline" if INSTALLED else "etc")

    def on(self, host: str, commands: str) -> list:
        """As they are typed there: each host has its own /etc/ledgerline and /var/lib."""
        if INSTALLED:
            return self.spaces[host].command("chroot", self.root / host / "root", "env", "-i", f"ROOT={self.root}", "HOME=/root",
                                             f"PATH={self.root}/bin:/usr/sbin:/usr/bin:/sbin:/bin", "sh", "-euc",
                                             f"cd {self.root}/{host}/home\n{commands}")
        commands = commands.replace("/etc/ledgerline", str(self.etc(host)))
        commands = re.sub(r"/var/lib/ledgerline(-\w+)?", str(self.root / host / "var"), commands)
        commands = commands.replace("ledgerline init --role", f"ledgerline init --state-dir {self.root / host}/var --role")
        commands = commands.replace("ledgerline doctor", f"ledgerline doctor --config-dir {self.etc(host)}")
        return self.spaces[host].command("env", f"ROOT={self.root}", f"PATH={self.root}/bin:{BIN}:{os.environ['PATH']}",
                                         "sh", "-euc", commands)

    def run(self, host: str, commands: str, code: int | None = 0) -> str:
        done = subprocess.run(self.on(host, commands), cwd=self.root / host / "home", capture_output=True, text=True,
                              timeout=STEP_S)
        assert code is None or done.returncode == code, f"{host}: {commands}\n{done.stdout}{done.stderr}"
        return done.stdout

    def start(self, host: str, commands: str) -> Program:
        """Ready."""
        start = functools.partial(self.spaces[host].popen, cwd=self.root / host / "home")
        program = Program(start, self.on(host, "exec " + commands.strip())[2:], self.root / f"{host}.{len(self.running)}.log")
        self.running.append(program)
        program.wait_ready(READY_S)
        return program

    def walk(self, wanted) -> None:
        """The page's blocks for which wanted(commands) is true."""
        for host, keeps, commands in blocks():
            if wanted(commands):
                self.start(host, commands) if keeps else self.run(host, commands)

    def doctor(self, host: str, *words: str, user: str = "") -> dict:
        """`user`: a command that makes it another's."""
        done = subprocess.run(self.on(host, " ".join([user + "ledgerline doctor --json --timeout 5", *words])),
                              cwd=self.root / host / "home", capture_output=True, text=True, timeout=STEP_S)
        return findings.of_doctor(done)

    def close(self) -> None:
        for program in reversed(self.running):
            program.process.terminate()
        for program in reversed(self.running):
            program.end(END_S)
        for space in self.spaces.values():
            space.close()
        for host in HOSTS if INSTALLED else ():
            subprocess.run(["umount", "--recursive", self.root / host / "root"], check=True)
        subprocess.run(["ip", "link", "del", "machines"], check=True)
