"""What every program answers alike: whatever lies in bin/ and is one of ours."""
import re
import subprocess

import pytest
from programs import BIN

PROGRAMS = sorted(path.name for path in BIN.iterdir() if re.fullmatch(r"ledgerline(-[a-z-]+)?", path.name))


def run(program: str, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / program, *arguments], capture_output=True, text=True, timeout=120)


def test_bin_has_the_programs():
    assert {"ledgerline", "ledgerline-agent", "ledgerline-fly", "ledgerline-link"} <= set(PROGRAMS)


@pytest.mark.parametrize("program", PROGRAMS)
def test_version_is_the_program_and_the_projects_version(program):
    shown = run(program, "--version")
    assert shown.returncode == 0 and shown.stderr == ""
    assert re.fullmatch(program + r" \d+\.\d+\.\d+\n", shown.stdout)
    assert shown.stdout.split()[1] == run("ledgerline", "--version").stdout.split()[1]


@pytest.mark.parametrize("program", PROGRAMS)
def test_help_is_a_result(program):
    shown = run(program, "--help")
    assert shown.returncode == 0
    assert "Usage" in shown.stdout or "usage" in shown.stdout


@pytest.mark.parametrize("program", PROGRAMS)
def test_what_a_program_does_not_know_is_bad_usage(program):
    refused = run(program, "--no-such-option")
    assert refused.returncode == 2
    assert refused.stdout == "" and refused.stderr != ""
