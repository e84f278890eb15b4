"""Every program and verb takes whatever it is given: random arguments, environments and files. It ends by itself or when it is asked to,
with an exit code, and never by a signal or an uncaught exception."""
import concurrent.futures
import os
import pathlib
import random
import shutil
import signal
import subprocess

import pytest
from programs import BIN

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
CASES = 20_000 if LONG else 600
SEED = int(os.environ.get("LEDGERLINE_SEED", "1"))
# Who serves, flies or measures goes on until it is asked to end. Not limits on speed: how long a broken program may take.
ASK_S, END_S = 2, 60
JUNK = ["", "-", "--", "-1", "0", "1", "65536", "99999999999999999999", "1e308", "nan", "inf", "0x10", "1..9", "9..1", "1,2", ",", "=", "a=b", "*", "tello1",
        "tello1/*", "../..", "Org1MSP", "127.0.0.1:1", "[::1]:0", "http://", "https://127.0.0.1:1/", "10ms", "on", "none", "manual", "\t", "\n", "%s%n", "ä", "\udcff\udcfe",
        "x" * 300, "x" * 70_000, "{}", "[", "\"", "'", "$(true)", "2026-11-29T01:02:03Z", "/proc/nowhere/at/all"]
VARIABLES = {"HOME": ["", "/proc/nowhere", "relative"], "LANG": ["C", "tr_TR.UTF-8", "x"], "LC_ALL": ["C", "de_DE.UTF-8"], "TMPDIR": ["/proc/nowhere", ""],
             "LEDGERLINE_LOG": ["trace", "x", ""], "LEDGERLINE_STATION": ["http://127.0.0.1:1", "x", ""], "LEDGERLINE_TOKEN_FILE": ["/proc/nowhere", ""],
             "LEDGERLINE_CA": ["/dev/null", "x"], "XDG_RUNTIME_DIR": ["/proc/nowhere", ""], "ROS_DOMAIN_ID": ["0", "233", "-1", "x", ""], "ROS_DISTRO": ["humble", "x"],
             "CYCLONEDDS_URI": ["x", "<a>", "file:///proc/nowhere"], "CHAINCODE_ID": ["x", ""], "NOTIFY_SOCKET": ["/proc/nowhere", "@"], "WATCHDOG_USEC": ["x", "1"],
             "PATH": ["", "/proc/nowhere"], "COLUMNS": ["1", "x"], "TERM": ["dumb", "x"]}


def completions(*words: str) -> list[str]:
    return subprocess.run([BIN / "ledgerline", "__complete", *words], capture_output=True, text=True, timeout=60).stdout.split()


def commands() -> list[tuple[list, list[str]]]:
    """Each verb, and each verb of a verb, with its options."""
    found = []
    for verb in completions(""):
        # `experiment` is a script that builds; two RouDis that start in one moment are ended by iceoryx itself.
        if verb in ("completion", "help", "version", "experiment", "roudi"):
            continue
        found.append(([BIN / "ledgerline", verb], completions(verb, "--")))
        for below in completions(verb, ""):
            found.append(([BIN / "ledgerline", verb, below], completions(verb, below, "--") or completions(verb, "--")))
    return found


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> list[str]:
    """Files and folders of all kinds, but of no kind that a program wants."""
    folder = tmp_path_factory.mktemp("files")
    texts = {"empty": b"", "bytes": bytes(range(256)) * 4, "toml": b"[ledger]\nendpoint = 1\n", "open.toml": b"[ledger\n", "json": b'{"a":[1', "csv": b"1,2\n3;4\n", "csv2": b"0,0\n1,1,1\n",
             "pem": b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n", "script.toml": b'[flight]\ndrones = 99999\n[[fault]]\nwhat = "x"\n'}
    for name, text in texts.items():
        (folder / name).write_bytes(text)
    (folder / "folder").mkdir()
    (folder / "loop").symlink_to(folder / "loop")
    os.mkfifo(folder / "pipe")
    return [str(path) for path in sorted(folder.iterdir())]


def case(number: int, known: list, files: list[str], home: pathlib.Path) -> str:
    """What is wrong with what came of one case; empty: nothing."""
    dice = random.Random(SEED * 1_000_003 + number)
    command, options = dice.choice(known)
    words = [*command]
    for _ in range(dice.choice((0, 1, 1, 2, 2, 3, 5))):
        value = dice.choice(JUNK + 3 * files)
        word = dice.choice(options) if options and dice.random() < 0.6 else value
        words += [word, value] if word.startswith("--") and dice.random() < 0.7 else [word]
    environment = {"PATH": os.environ["PATH"], "LEDGERLINE_BIN": "/proc/nowhere"}  # nothing is started by what is random
    for name in dice.sample(sorted(VARIABLES), dice.choice((0, 0, 1, 3))):
        environment[name] = dice.choice(VARIABLES[name])
    here = home / str(number)
    here.mkdir()
    output = open("/dev/full", "wb") if dice.random() < 0.05 else subprocess.DEVNULL
    program = subprocess.Popen(words, cwd=here, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.PIPE, start_new_session=True)
    if dice.random() < 0.03:
        shutil.rmtree(here, ignore_errors=True)  # its working folder goes while it starts
    asked = False
    try:
        _, said = program.communicate(timeout=ASK_S)
    except subprocess.TimeoutExpired:
        asked = True
        program.send_signal(signal.SIGINT)
        try:
            _, said = program.communicate(timeout=END_S)
        except subprocess.TimeoutExpired:
            os.killpg(program.pid, signal.SIGKILL)
            program.communicate()
            return f"{words}, {environment}: it does not end when asked to"
    finally:
        shutil.rmtree(here, ignore_errors=True)
    fine = program.returncode in (0, 1, 2, 3) or (asked and program.returncode == -signal.SIGINT)
    if fine and not any(words in said for words in (b"terminate called", b"Sanitizer", b"which is not here")):
        return ""
    return f"{words}, {environment}: {program.returncode}: {said[-500:].decode(errors='replace')}"


def test_no_argument_environment_or_file_makes_a_program_crash_or_hang(files, tmp_path):
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and its children with it
    known = commands()
    assert len(known) > 100, known
    with concurrent.futures.ThreadPoolExecutor(2 * (os.cpu_count() or 1)) as pool:
        wrong = [said for said in pool.map(lambda number: case(number, known, files, tmp_path), range(CASES)) if said]
    assert not wrong, f"{len(wrong)} of {CASES}:\n" + "\n".join(wrong[:20])
