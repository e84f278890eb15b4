"""Somebody's own code under `ledgerline fault run`: the examples as they are, and with a mistake put in."""
import json
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
EXAMPLES = ROOT / "hil/fault/examples"
SCENARIOS = ROOT / "hil/scenarios/own"
TIMEOUT_S = 300  # not a limit on speed: only how long a broken test may take


def run(scenario: pathlib.Path, *options) -> subprocess.CompletedProcess:
    done = subprocess.run([BIN / "ledgerline", "fault", "run", scenario, *options], capture_output=True, text=True, timeout=TIMEOUT_S)
    print(done.stdout, done.stderr, flush=True)
    return done


def fly(directory: pathlib.Path, scenario: str, program: pathlib.Path, *options: str) -> tuple[int, dict]:
    """By a program, in real time: the exit code, and the run as JSON."""
    result = directory / "run.json"
    done = run(SCENARIOS / f"{scenario}.toml", "--real", "--out", directory / "r", "--json", result, "--junit", directory / "run.xml",
               "--program", f"'{sys.executable}' '{program}'", *options)
    folder = directory / "r" / f"{scenario}-1"
    for name in ("program.out", "program.log"):
        if (folder / name).exists():
            print(name, (folder / name).read_text()[-2000:], flush=True)
    flown = json.loads(result.read_text())["runs"]
    assert flown, done.stderr
    assert ("<failure" in (directory / "run.xml").read_text()) == (done.returncode == 1)
    return done.returncode, flown[0]


def broken(flown: dict) -> dict:
    """The rules that broke, and what was seen."""
    return {verdict["rule"]: verdict["what"] for verdict in flown["verdicts"] if verdict["held"] is False}


def planted(directory: pathlib.Path, example: str, right: str, wrong: str) -> pathlib.Path:
    """The example with one piece of it replaced, which must be there."""
    text = (EXAMPLES / example).read_text()
    assert text.count(right) == 1, f"{example} has no line any more for the planted mistake"
    program = directory / f"planted_{example}"
    program.write_text(text.replace(right, wrong))
    return program
