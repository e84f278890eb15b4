"""What every program and every verb of `ledgerline` answers alike."""
import pathlib
import re
import shutil
import subprocess

import pytest
from programs import BIN

ROOT = pathlib.Path(__file__).parents[3]
DAEMONS = {f"ledgerline-{name}" for name in ("agent", "bridge", "chaincode", "endorser", "ground", "link", "node", "roudi", "sim")}
GROUPS = {f"ledgerline-{name}" for name in ("control", "experiment", "fault", "fly", "ledger", "station", "tools")}


def run(program: str, *arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / program.split()[0], *program.split()[1:], *arguments], capture_output=True, text=True, timeout=120)


def verbs() -> list[str]:
    """As `ledgerline --help` lists them."""
    return [f"ledgerline {verb}" for verb in re.findall(r"^  ([a-z-]+) +\S.*[^:]$", run("ledgerline", "--help").stdout, re.MULTILINE) if verb != "ledgerline"]


PROGRAMS = sorted(DAEMONS | {"ledgerline"}) + [verb for verb in verbs() if verb.replace(" ", "-") not in DAEMONS]


def test_bin_has_ledgerline_and_the_daemons_and_all_else_is_a_verb():
    assert {path.name for path in BIN.glob("ledgerline*")} == DAEMONS | {"ledgerline"}
    libexec = BIN.parent / "libexec/ledgerline"
    assert {path.name for path in libexec.iterdir()} == GROUPS
    has = [subprocess.run([libexec / name], capture_output=True, text=True, timeout=60).stderr for name in GROUPS - {"ledgerline-experiment"}]
    in_groups = {verb for said in has for verb in said.partition("here are:")[2].split()}
    services = {name.removeprefix("ledgerline-") for name in DAEMONS}
    assert {f"ledgerline {verb}" for verb in in_groups | services | {"experiment"}} == set(verbs())


@pytest.mark.parametrize("typed, meant", [("flye", "fly"), ("contrl", "control"), ("fly --lapz 3", "--laps"), ("control stpo tello1", "stop"), ("status --jso", "--json")])
def test_what_is_nearly_right_is_answered_with_what_was_meant(typed, meant):
    refused = run("ledgerline", *typed.split())
    assert refused.returncode == 2 and f"did you mean {meant}?" in refused.stderr


def test_the_page_of_commands_is_what_the_programs_say():
    printed = subprocess.run([ROOT / "scripts/commands-page", BIN / "ledgerline"], capture_output=True, text=True, check=True, timeout=60)
    assert printed.stdout == (ROOT / "docs/commands.md").read_text(), "print it again: scripts/commands-page build/release/bin/ledgerline > docs/commands.md"


def test_fly_says_what_it_can_where_nothing_is_built(tmp_path):
    """A tree of sources alone, and no tool to build it with."""
    for name in ("fly", "scripts/setup.sh", "docs/commands.md"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    said = subprocess.run([tmp_path / "fly", "--help"], capture_output=True, text=True, timeout=60)
    assert said.returncode == 0 and "--drones" in said.stdout and "```" not in said.stdout and "## " not in said.stdout
    assert {path.name for path in tmp_path.iterdir()} == {"fly", "scripts", "docs"}


def test_help_of_a_verb_is_the_verbs_help():
    assert "\n  ledgerline timing" in run("ledgerline", "help", "timing").stdout
    for verb in ("fly", "control stop", "agent"):
        assert run("ledgerline", *f"help {verb}".split()).stdout == run("ledgerline", *f"{verb} --help".split()).stdout != ""


def test_what_is_like_nothing_gets_no_suggestion():
    refused = run("ledgerline", "xyzzy")
    assert refused.returncode == 2 and "did you mean" not in refused.stderr and "ledgerline --help" in refused.stderr
    for verb in ("fault", "tello"):
        refused = run("ledgerline", verb, "nofile")
        assert refused.returncode == 2 and 'there is no "nofile": ' in refused.stderr and "ubcommand" not in refused.stderr


@pytest.mark.parametrize("program", PROGRAMS)
def test_version_is_the_program_and_the_projects_version(program):
    shown = run(program, "--version")
    assert shown.returncode == 0 and shown.stderr == ""
    assert re.fullmatch(program + r" \d+\.\d+\.\d+\n", shown.stdout)
    assert shown.stdout.split()[-1] == run("ledgerline", "--version").stdout.split()[-1]


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


CONFIGS = ["agent {}", "agent --config {}", "audit --config {}", "bridge {}", "bridge --config {}", "contract status --config {}",
           "control --config {} show", "drones --config {}", "endorser {}", "fabric up --dir none --config {}", "fly --deployment {}", "ground {}",
           "hil proxy --config {}", "ledger get --config {} a/b", "ledger tx --config {} 3f5a", "link {}",
           "local {}", "missions --config {}", "receipt --config {} 3f5a", "tello preflight --deployment {}"]


@pytest.mark.parametrize("typed", CONFIGS)
def test_a_config_that_is_missing_or_wrong_is_bad_usage(typed, tmp_path):
    wrong = tmp_path / "wrong.toml"
    for text in (None, "[ledger", "[ledger]\nendpoit = 3\n[service]\nlisen = 3\n"):
        if text is not None:
            wrong.write_text(text)
        refused = run("ledgerline", *typed.format(wrong).split())
        assert refused.returncode == 2 and str(wrong) in refused.stdout + refused.stderr, (text, refused)


@pytest.mark.parametrize("typed, says", [
    ("contract install --endpoint a:1", "--package FILE"), ("contract approve --endpoint a:1 --print", "--package-id LABEL:HASH"),
    ("contract package --address cc", "--address "), ("contract package --address cc:1 --label .x", "--label: ")])
def test_what_a_step_of_the_lifecycle_lacks_is_bad_usage(typed, says, tmp_path):
    refused = run("ledgerline", *typed.split())
    assert refused.returncode == 2 and says in refused.stderr, refused


@pytest.mark.parametrize("program", ["ledgerline node --dir none", "ledgerline fly --watch"])
def test_an_address_that_is_none_is_bad_usage_and_its_option_is_named(program):
    for wrong in ("nowhere", "127.0.0.1:99999"):
        refused = run(program, "--listen", wrong)
        assert refused.returncode == 2 and refused.stderr.startswith("--listen: ") and wrong in refused.stderr, refused.stderr
