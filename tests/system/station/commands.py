"""The station's command line as a person has it: an environment, a folder for his session, and his pass phrase."""
import contextlib
import json
import os
import pathlib
import pty
import re
import subprocess

from flights import BIN, printed
from station import Station


class Person:
    def __init__(self, home: pathlib.Path, station: Station, out: pathlib.Path, name: str = "") -> None:
        home.mkdir()
        self.home, self.out, self.name = home, out, name
        self.environment = {"PATH": os.environ["PATH"], "LEDGERLINE_STATION": station.url,
                            "LEDGERLINE_TOKEN_FILE": str(out / "run" / "page.token"), "XDG_RUNTIME_DIR": str(home)}

    def run(self, *words, expect: int | None = 0, **environment: str) -> subprocess.CompletedProcess:
        done = subprocess.run([BIN / "ledgerline", *map(str, words)], capture_output=True, text=True, timeout=90,
                              env=self.environment | environment)
        assert expect is None or done.returncode == expect, (words, done.stdout, done.stderr)
        return done

    def says(self, *words) -> str:
        return self.run(*words).stdout

    def json(self, *words) -> dict:
        return json.loads(self.says(*words, "--json"))

    def refused(self, *words, **environment: str) -> str:
        done = self.run(*words, expect=1, **environment)
        assert done.stdout == "", done.stdout
        return done.stderr

    def misused(self, *words, **environment: str) -> str:
        return self.run(*words, expect=2, **environment).stderr

    def start(self, *words) -> subprocess.Popen:
        """One that goes on until a signal."""
        return subprocess.Popen([BIN / "ledgerline", *words], stdout=subprocess.PIPE, text=True, env=self.environment)

    def phrase_file(self) -> pathlib.Path:
        file = self.home / "phrase"
        file.write_text(re.search(rf"Operator {self.name}: pass phrase (\w+)", printed(self.out))[1] + "\n")
        file.chmod(0o600)
        return file

    def log_in(self) -> str:
        return self.says("drones", "login", "--operator", self.name, "--pass-phrase-file", self.phrase_file())

    def log_in_at_a_terminal(self) -> str:
        """What its screen shows."""
        mine, terminal = pty.openpty()
        program = subprocess.Popen([BIN / "ledgerline", "drones", "login", "--operator", self.name], stdin=terminal, stdout=terminal,
                                   stderr=terminal, env=self.environment)
        shown = b""
        while b"Pass phrase of" not in shown:
            shown += os.read(mine, 4096)
        os.write(mine, self.phrase_file().read_bytes())
        assert program.wait(60) == 0
        os.close(terminal)
        with contextlib.suppress(OSError):  # its end
            while more := os.read(mine, 4096):
                shown += more
        os.close(mine)
        return shown.decode()

    def session_file(self) -> pathlib.Path:
        return next((self.home / "ledgerline").iterdir())
