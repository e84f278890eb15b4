"""docs/three-machines.md from its first command to the landing, and what doctor says when something is broken."""
import json
import os
import time

import breakages
import field
import pytest
from walk import INSTALLED, Machines

LONG = os.environ.get("LEDGERLINE_LONG", "0") == "1"
QUICK = {"config_wrong", "key_open", "key_misfit", "identity_expired", "authority_foreign", "port_closed", "tls_wrong_name",
         "not_enrolled", "interface_down", "disk_full"}
QUICK_IN_THE_FIELD = {"authority_first", "endorser_copied", "locked_key", "chown_forgotten", "old_script_listens"}


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    machines = Machines(tmp_path_factory.mktemp("machines"))
    yield machines
    machines.close()


def is_flight(commands: str) -> bool:
    return any(word in commands for word in (" sim ", " roudi", " link ", " agent ", " ground --config", " acquire "))


def test_everything_before_the_flight_is_well_by_doctor(machines):
    machines.walk(lambda commands: not is_flight(commands))  # its doctors end with 0, or the walk fails
    assert "agent.toml" in machines.doctor("raven")["not_running"]["what"]
    assert "LEDGERLINE_LISTEN=10.77.0.2:7051\n" in (machines.etc("tower") / "node.env").read_text()
    ledger = machines.doctor("tower", "--role", "ledger")
    assert "not_running" not in ledger and not [each for each in ledger.values() if each["verdict"] == "broken"], ledger


@pytest.mark.parametrize("one", breakages.ALL, ids=lambda one: one.problem)
def test_what_is_broken_is_named_and_its_cure_works(machines, one):
    if INSTALLED:
        pytest.skip("breaks files where the build's programs have them")
    if not LONG and one.problem not in QUICK:
        pytest.skip("with LEDGERLINE_LONG=1")
    with one.broken(machines):
        found = machines.doctor(one.host, *one.words)
        assert one.problem in found, found
        assert found[one.problem]["cure"]
    assert one.problem not in machines.doctor(one.host, *one.words)


@pytest.mark.parametrize("one", field.ALL, ids=lambda one: one.name)
def test_a_fault_of_the_field_is_named_and_gone_when_its_cure_is_carried_out(machines, one):
    if not LONG and one.name not in QUICK_IN_THE_FIELD:
        pytest.skip("with LEDGERLINE_LONG=1")
    if one.needs and not machines.run(one.host, f"command -v {one.needs}", code=None):
        pytest.skip(f"{one.host} has no {one.needs}")
    with one.broken(machines):
        found = machines.doctor(one.host, *one.words, user=one.user)
        assert one.problem in found, found
        one.cure(machines, found[one.problem]["cure"])
        left = {problem: each for problem, each in machines.doctor(one.host, *one.words, user=one.user).items()
                if each["verdict"] == "broken" or problem == one.problem}
        assert not left, left


@pytest.mark.parametrize("well", [field.two_addresses, field.two_keys], ids=lambda well: well.__name__)
def test_what_programs_take_is_no_fault(machines, well):
    if not LONG:
        pytest.skip("with LEDGERLINE_LONG=1")
    with well(machines):
        found = machines.doctor("raven")
        assert not [each for each in found.values() if each["verdict"] == "broken"], found


def test_a_clock_that_goes_wrong_is_reported_by_the_blocks(machines):
    if not LONG:
        pytest.skip("with LEDGERLINE_LONG=1")
    time.sleep(6)  # the certificates are older than the clock is wrong: else they are what is reported
    field.enroll_a_user(machines, 1)
    found = machines.doctor("raven", user="env FAKETIME_DONT_FAKE_MONOTONIC=1 faketime -f -5s ")
    assert "clock_behind" in found and "by NTP" in found["clock_behind"]["cure"], found
    assert "clock_behind" not in machines.doctor("raven")


def test_the_page_flies(machines):
    machines.walk(is_flight)
    for _ in range(120):
        drones = json.loads(machines.run("ground", "ledgerline drones --config /etc/ledgerline/ground.toml --json"))["drones"]
        if drones[0]["phase"] == "landed":
            break
        time.sleep(0.5)
    assert [(one["phase"], one["why"]) for one in drones] == [("landed", "")], drones
    assert "stopped" not in machines.doctor("ground")
