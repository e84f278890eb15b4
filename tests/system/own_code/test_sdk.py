"""An unmodified djitellopy script under test, over the proxy."""
import json
import pathlib
import sys
import time

from own_code import EXAMPLES, broken, fly, planted, run, SCENARIOS


def test_a_script_that_asks_again_passes(tmp_path):
    code, flown = fly(tmp_path, "sdk-client-errors", EXAMPLES / "sdk_square.py")
    assert code == 0, broken(flown)
    said = (tmp_path / "r/sdk-client-errors-1/program.out").read_text()
    assert "was unsuccessful" in said, "the fault was there, and the script heard of it"


def test_one_that_ignores_an_error_is_caught(tmp_path):
    program = planted(tmp_path, "sdk_square.py", "            if time.monotonic() > begin + TIMEOUT_S:\n                raise\n", "            return\n")
    code, flown = fly(tmp_path, "sdk-client-errors", program)
    assert code == 1
    assert "corners within 0.5 m" in broken(flown)
    assert "finishes" not in broken(flown), "to itself it looks fine: it landed, with exit code 0"


def test_what_has_no_link_is_refused_before_anything_flies(tmp_path):
    script = tmp_path / "script.toml"
    script.write_text('title = "t"\nmust = ["hold is seen"]\n[flight]\nkind = "sdk"\n[[fault]]\nwhat = "ledger both stall"\n')
    done = run(script, "--real", "--out", tmp_path / "out", "--program", "true")
    assert done.returncode == 2
    assert "there is no ledger in a flight by the SDK" in done.stderr and "link says that" in done.stderr
    done = run(SCENARIOS / "sdk-client-errors.toml")
    assert done.returncode == 2 and "give --program" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_program_that_fails_breaks_the_run(tmp_path):
    program = tmp_path / "gives_up.py"
    program.write_text("import sys\nprint('no drone today')\nprint('a\\nb', file=sys.stderr)\nsys.exit(3)\n")
    code, flown = fly(tmp_path, "sdk-client-errors", program)
    assert code == 1
    seen = broken(flown)
    ended = seen["your program ends by itself, with exit code 0"]
    assert ended.startswith("it ended with exit code 3\n") and ended.endswith("\n  a\n  b"), "each line of its log by itself"
    assert seen["finishes"] == "tello1 never took off"


def test_one_that_never_ends_is_ended_with_all_that_it_started(tmp_path):
    left = tmp_path / "left"
    program = tmp_path / "hangs.py"
    program.write_text("import subprocess, time\n"
                       f"child = subprocess.Popen(['sleep', '600'])\nopen({str(left)!r}, 'w').write(str(child.pid))\ntime.sleep(600)\n")
    script = tmp_path / "hangs.toml"
    script.write_text('title = "t"\nmust = ["no crash"]\n[flight]\nkind = "sdk"\nlimit = "6 s"\n')
    done = run(script, "--real", "--out", tmp_path / "out", "--json", tmp_path / "r.json", "--program", f"'{sys.executable}' '{program}'")
    assert done.returncode == 1
    flown = json.loads((tmp_path / "r.json").read_text())["runs"][0]
    assert "still ran" in broken(flown)["your program ends by itself, with exit code 0"]
    # Nobody may be there to take its exit code; then its name is gone, at least.
    command = pathlib.Path(f"/proc/{left.read_text()}/cmdline")
    until = time.monotonic() + 10
    while command.exists() and command.read_bytes():
        assert time.monotonic() < until, command.read_bytes()
        time.sleep(0.05)
