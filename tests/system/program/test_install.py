"""What `cmake --install` puts in place, part by part: programs, units, users and example configs (docs/three-machines.md)."""
import os
import pathlib
import re
import shutil
import subprocess
import time

import pytest

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
ROOT = pathlib.Path(__file__).parents[3]
UNITS = {"onboard": ["roudi", "link", "agent"], "ground": ["ground", "bridge"], "ledger": ["node", "chaincode", "endorser"]}
USERS = {"roudi": "ledgerline", "link": "ledgerline", "agent": "ledgerline"}
PROGRAMS = {"common": {""}, "onboard": {"roudi", "link", "agent"}, "ledger": {"node", "chaincode", "endorser"}, "ground": {"ground", "bridge"}, "tools": {"sim"}}
GROUPS = {"common": {"ledger"}, "ground": {"control", "station"}, "tools": {"fault", "fly", "tools"}}  # of verbs
EXAMPLES = {"onboard": {"link.toml", "agent.toml"}, "ground": {"ground.toml", "bridge.toml"},
            "ledger": {"endorser.toml", "node.env", "chaincode.env"}}
# Exposure as `systemd-analyze security` has it, 0 to 10; a unit without any setting has 9.6.
MAX_EXPOSURE = 2.3


@pytest.fixture(scope="module")
def parts(tmp_path_factory) -> dict[str, pathlib.Path]:
    folders = {}
    for part in ("common", "onboard", "ground", "ledger", "tools"):
        folders[part] = tmp_path_factory.mktemp(part)
        subprocess.run(["cmake", "--install", BIN.parent, "--component", part, "--prefix", folders[part]], check=True, capture_output=True)
    return folders


@pytest.fixture(scope="module")
def whole(parts, tmp_path_factory) -> pathlib.Path:
    """All parts below one prefix."""
    prefix = tmp_path_factory.mktemp("whole")
    for part in parts:
        subprocess.run(["cmake", "--install", BIN.parent, "--component", part, "--prefix", prefix], check=True, capture_output=True)
    return prefix


def names(folder: pathlib.Path, pattern: str) -> set[str]:
    return {path.name for path in folder.glob(pattern)}


@pytest.mark.parametrize("part", PROGRAMS)
def test_a_part_has_its_programs_units_users_and_examples(parts, part):
    folder = parts[part]
    assert names(folder, "bin/*") == {f"ledgerline-{name}".rstrip("-") for name in PROGRAMS[part]}
    assert names(folder, "libexec/ledgerline/*") == {f"ledgerline-{name}" for name in GROUPS.get(part, set())}
    assert names(folder, "lib/systemd/system/*.service") == {f"ledgerline-{name}.service" for name in UNITS.get(part, [])}
    assert names(folder, "lib/sysusers.d/*") == ({f"ledgerline-{part}.conf"} if part in UNITS else set())
    assert names(folder, f"share/doc/ledgerline-{part}/examples/*") == EXAMPLES.get(part, set())


def test_no_two_parts_have_the_same_file(parts):
    files = [str(path.relative_to(folder)) for folder in parts.values() for path in folder.rglob("*") if path.is_file()]
    assert len(files) == len(set(files))


def test_what_is_installed_names_no_folder_of_the_build(parts):
    for path in (path for folder in parts.values() for path in folder.rglob("*") if path.is_file()):
        if path.parent.name in ("bin", "ledgerline") and os.access(path, os.X_OK):  # what debugging symbols say is not in the packages
            subprocess.run(["strip", path], check=True)
        assert str(ROOT).encode() not in path.read_bytes(), path


@pytest.mark.parametrize("part, unit", [(part, unit) for part, units in UNITS.items() for unit in units])
def test_a_unit_starts_what_is_there_as_a_user_that_is_made(whole, part, unit):
    text = (whole / f"lib/systemd/system/ledgerline-{unit}.service").read_text()
    program = re.search(r"^ExecStart=(\S+)", text, re.MULTILINE)[1]
    assert program == str(whole / f"bin/ledgerline-{unit}") and os.access(program, os.X_OK)
    user = re.search(r"^User=(.+)$", text, re.MULTILINE)[1]
    assert user == USERS.get(unit, f"ledgerline-{unit}")
    assert f"u {user} - " in (whole / f"lib/sysusers.d/ledgerline-{part}.conf").read_text()
    assert f"StateDirectory={user}\n" in text
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd is not here")
    unit_file = whole / "lib/systemd/system" / f"ledgerline-{unit}.service"
    ran = subprocess.run(["systemd-analyze", "verify", "--man=no", "--recursive-errors=no", unit_file], capture_output=True, text=True)
    assert (ran.returncode, ran.stderr) == (0, "")


@pytest.mark.parametrize("unit", [unit for units in UNITS.values() for unit in units])
def test_a_unit_is_hardened(whole, tmp_path, unit):
    if not shutil.which("systemd-analyze"):
        pytest.skip("systemd is not here")
    units = tmp_path / "etc/systemd/system"
    shutil.copytree(whole / "lib/systemd/system", units)
    for file in units.glob("*.service"):
        file.write_text(re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", file.read_text(), flags=re.MULTILINE))
    (tmp_path / "bin").mkdir()
    shutil.copy("/bin/true", tmp_path / "bin/true")
    ran = subprocess.run(["systemd-analyze", "security", "--offline=true", "--no-pager", f"--root={tmp_path}", f"ledgerline-{unit}.service"],
                         capture_output=True, text=True)
    exposure = re.search(r"Overall exposure level for \S+: ([0-9.]+)", ran.stdout)
    assert exposure, ran.stdout + ran.stderr
    assert float(exposure[1]) <= MAX_EXPOSURE, ran.stdout


@pytest.mark.parametrize("name, words", [("agent", ["--config"]), ("ground", ["--config"]), ("bridge", []), ("endorser", [])])
def test_an_example_lacks_nothing_but_the_identity_that_it_names(whole, name, words):
    example = next(whole.glob(f"share/doc/*/examples/{name}.toml"))
    ran = subprocess.run([whole / f"bin/ledgerline-{name}", *words, example], capture_output=True, text=True, timeout=60)
    assert ran.returncode == 2
    assert f"cannot read folder /etc/ledgerline/{name}/signcerts" in ran.stderr


def test_the_example_of_link_lacks_nothing_but_roudi(whole, tmp_path):
    example = whole / "share/doc/ledgerline-onboard/examples/link.toml"
    ran = subprocess.run([whole / "bin/ledgerline-link", "--config", example], capture_output=True, text=True, timeout=60, cwd=tmp_path)
    assert ran.returncode == 1 and "RouDi does not answer" in ran.stderr


def test_the_example_of_the_chaincode_has_what_the_service_asks_for(whole):
    lines = (whole / "share/doc/ledgerline-ledger/examples/chaincode.env").read_text().splitlines()
    environment = dict(line.split("=", 1) for line in lines if not line.startswith("#"))
    ran = subprocess.run([whole / "bin/ledgerline-chaincode"], env={**os.environ, **environment}, capture_output=True, text=True, timeout=60)
    assert ran.returncode != 0 and "/etc/ledgerline/chaincode/server.key" in ran.stderr


def test_roudi_says_which_process_is_in_its_way(tmp_path):
    if not shutil.which("iox-roudi"):
        pytest.skip("iceoryx's own RouDi is not here")
    outsiders = subprocess.Popen(["iox-roudi"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        deadline = time.monotonic() + 30
        while not pathlib.Path("/tmp/roudi").exists():
            assert outsiders.poll() is None and time.monotonic() < deadline
            time.sleep(0.05)
        ran = subprocess.run([BIN / "ledgerline-roudi"], capture_output=True, text=True, timeout=60)
    finally:
        outsiders.terminate()
        outsiders.wait(20)
    assert ran.returncode == 1
    assert f"iox-roudi (process {outsiders.pid})" in ran.stderr and f"kill {outsiders.pid}" in ran.stderr
