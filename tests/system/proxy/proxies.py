"""ledgerline hil proxy, as a test starts it."""
import json
import os
import pathlib
import subprocess

from netns import die_with_parent

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
HIL = (BIN / "ledgerline", "hil")
TIMEOUT_S = 60  # not a limit on speed: only how long a broken test may take


class Proxy:
    """Drones are (name, listen, address), servers too, with ports; stands until end()."""

    def __init__(self, directory: pathlib.Path, drones=(), servers=(), source: str = "127.0.2.1", script: str = "",
                 command=lambda *words: list(words)):
        self.directory = directory
        self.socket = directory / "f.sock"
        self.summary_file = directory / "proxy.json"
        tables = "".join(f'[[{kind}]]\nname = "{name}"\nlisten = "{listen}"\naddress = "{address}"\n'
                         for kind, routes in (("drone", drones), ("server", servers)) for name, listen, address in routes)
        config, script_file = directory / "proxy.toml", directory / "script.toml"
        config.write_text(f'[proxy]\nseed = 3\nfaults = "{self.socket}"\nsummary = "{self.summary_file}"\nsource = "{source}"\n{tables}')
        script_file.write_text(script)
        self.process = subprocess.Popen(
            command(*HIL, "proxy", "--config", config, *(["--script", script_file] if script else [])),
            stdout=subprocess.PIPE, stderr=open(directory / "proxy.log", "wb"), text=True, preexec_fn=die_with_parent)
        ready = self.process.stdout.readline()
        assert ready, (directory / "proxy.log").read_text()
        self.servers = json.loads(ready)["servers"]

    def tell(self, command: str) -> str:
        return tell(self.socket, command)

    def end(self) -> dict:
        self.process.terminate()
        assert self.process.wait(TIMEOUT_S) == 0, (self.directory / "proxy.log").read_text()
        return json.loads(self.summary_file.read_text())

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


def tell(socket: pathlib.Path, command: str) -> str:
    """`ledgerline hil faults`, which must succeed."""
    done = subprocess.run([*HIL, "faults", socket, command], capture_output=True, text=True, timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stderr
    return done.stdout
