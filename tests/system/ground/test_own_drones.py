"""`ledgerline fly --deployment` of drones that are there already: here those of a simulator that the test runs."""
import contextlib
import json
import pathlib
import re
import signal
import subprocess

from flights import (BIN, POSES, SAFE, assert_nothing_left, control, deployment, fly, no_flight_outlives_its_test, printed, result, somebody_elses,
                     somebody_elses_drones, wait_for_flight)


def test_a_short_square(tmp_path):
    file = deployment(tmp_path, POSES + SAFE + '[flight]\nshape = "square"\nside_m = 0.8\nlaps = 1\n')
    with somebody_elses_drones(tmp_path):
        flight = fly(tmp_path, "--deployment", file)
        assert flight.wait(90) == 0, printed(tmp_path)
    text = printed(tmp_path)
    for well in (r"drone +tello1: 127\.0\.0\.2", r"battery +tello1: \d+ %", r"pose +tello1: /vrpn_mocap/tello1/pose, \d+ ms old",
                 r"lease +tello1: ours", r"fence +x -3 to 3, y -3 to 3, z 0 to 2 m", r"ledger +embedded: reached"):
        assert re.search(r"(?m)^ok +" + well, text), text
    assert re.search(r"(?m)^(ok|warning) +clock ", text), text
    assert "no truth: a real drone" in text
    report = result(tmp_path)
    assert report["ok"] is True and report["asked"]["own_drones"] is True
    assert report["drones"][0]["cross_track_m"] is None and len(report["drones"][0]["lap_s"]) == 1
    assert "no truth: a real drone" in (tmp_path / "run" / "report.html").read_text()
    assert "max_m = [ 3, 3, 2 ]" in (tmp_path / "run" / "link.toml").read_text()
    assert not (tmp_path / "run" / "sim.trace").exists()
    assert_nothing_left()


def test_ctrl_c_in_mid_flight_lands(tmp_path):
    file = deployment(tmp_path, POSES + SAFE + "[flight]\nlaps = 50\n")
    with somebody_elses_drones(tmp_path):
        flight = fly(tmp_path, "--deployment", file)
        wait_for_flight(tmp_path, flight)
        flight.send_signal(signal.SIGINT)
        assert flight.wait(60) == 1, printed(tmp_path)
    assert "Landing all drones" in printed(tmp_path)
    link = json.loads((tmp_path / "run" / "link.summary.json").read_text())
    assert link["drones"][0]["phase"] in ("on_ground", "landed"), link["drones"][0]
    assert_nothing_left()


@contextlib.contextmanager
def somebody_elses_network(directory: pathlib.Path, *options: str):
    """A ledger that fly did not start, and the files that say how agent, ground and an administrator reach it."""
    with somebody_elses(BIN / "ledgerline-node", "--dir", directory / "network", "--listen", "127.0.0.1:0", *options) as (line, _):
        endpoint = line["endpoint"]
        organisations = directory / "network" / "crypto" / "peerOrganizations"

        def ledger(name: str, k: int, user: str, trusts: bool = True) -> None:
            own = organisations / f"org{k}.ledgerline"
            text = (f'[ledger]\nendpoint = "{endpoint}"\nmsp_id = "Org{k}MSP"\n'
                    f'tls_ca = "{organisations}/org1.ledgerline/tlsca/tlsca.org1.ledgerline-cert.pem"\n'
                    f'msp_dir = "{own}/users/{user}@org{k}.ledgerline/msp"\n'
                    f'config_block = "{directory}/network/teleop.block"\n')
            for i in (1, 2, 3) if trusts else ():
                text += f'[[msp]]\nid = "Org{i}MSP"\nca = "{organisations}/org{i}.ledgerline/ca/ca.org{i}.ledgerline-cert.pem"\n'
            (directory / f"{name}.toml").write_text(text)

        ledger("agent", 1, "User1")
        ledger("ground", 2, "User1")
        ledger("admin", 1, "Admin")
        ledger("admin2", 2, "Admin", trusts=False)
        ledger("other", 2, "User2", trusts=False)
        yield organisations


def test_a_network_of_others(tmp_path):
    names = "".join(f'{name} = "{tmp_path}/{name}.toml"\n' for name in ("agent", "ground", "admin"))
    file = deployment(tmp_path, POSES + SAFE + f'[flight]\nside_m = 0.8\nlaps = 1\n[ledger]\nkind = "existing"\n{names}')
    with somebody_elses_drones(tmp_path), somebody_elses_network(tmp_path):
        flight = fly(tmp_path, "--deployment", file)
        assert flight.wait(90) == 0, printed(tmp_path)
        assert holder_of_tello1(tmp_path) is None
    assert result(tmp_path)["ok"] is True and len(result(tmp_path)["drones"][0]["lap_s"]) == 1
    assert "ledger: a network of others" in printed(tmp_path) and result(tmp_path)["ledger"]["kind"] == "existing"
    assert_nothing_left()


def holder_of_tello1(directory: pathlib.Path) -> dict | None:
    shown = subprocess.run([BIN / "ledgerline", "control", "--config", directory / "ground.toml", "show", "--json", "tello1"],
                           capture_output=True, text=True, timeout=60)
    assert shown.returncode == 0, shown.stderr
    return json.loads(shown.stdout)["controls"][0].get("holder")


def test_what_fly_acquired_it_gives_back_though_no_drone_answers(tmp_path):
    names = "".join(f'{name} = "{tmp_path}/{name}.toml"\n' for name in ("agent", "ground", "admin"))
    file = deployment(tmp_path, POSES + SAFE + f'[flight]\nwait_s = 4\n[ledger]\nkind = "existing"\n{names}')
    with somebody_elses_network(tmp_path):
        assert "not ready after 4 s" in refusal(tmp_path, file, 1)
        assert holder_of_tello1(tmp_path) is None
        control(tmp_path / "ground.toml", "acquire", "tello1")
        assert "not ready after 4 s" in refusal(tmp_path / "second", file, 1)
        assert holder_of_tello1(tmp_path) is not None, "it was held before"
    assert_nothing_left()


def test_blocks_that_come_too_late_are_refused_before_take_off(tmp_path):
    names = "".join(f'{name} = "{tmp_path}/{name}.toml"\n' for name in ("agent", "ground"))
    file = deployment(tmp_path, POSES + SAFE + f'[ledger]\nkind = "existing"\n{names}')
    with somebody_elses_drones(tmp_path), somebody_elses_network(tmp_path, "--batch-timeout", "2000", "--batch-count", "10"):
        refused = refusal(tmp_path, file, 1)
        assert "the file of ledger.agent: 10 transactions or 2000 ms a block" in refused, refused
        assert 'set timeouts = "auto" in [ledger] of the file of ledger.agent' in refused, refused
        for name in ("agent", "ground"):
            config = tmp_path / f"{name}.toml"
            config.write_text(config.read_text().replace("[ledger]", '[ledger]\ntimeouts = "auto"'))
        assert preflight(file)[1][None, "blocks"]["verdict"] == "ok"
    assert_nothing_left()


def preflight(file: pathlib.Path) -> tuple[int, dict]:
    """Exit code, and each check: a drone's name or nothing, and what is looked at."""
    ended = subprocess.run([BIN / "ledgerline", "tello", "preflight", "--deployment", file, "--seconds", "1.5", "--json"],
                           capture_output=True, text=True, timeout=60)
    assert ended.stdout, ended.stderr
    return ended.returncode, {(check["drone"], check["check"]): check for check in json.loads(ended.stdout)["checks"]}


def test_preflight_names_what_is_wrong_and_its_cure_and_fly_refuses_it(tmp_path):
    names = "".join(f'{name} = "{tmp_path}/{name}.toml"\n' for name in ("agent", "ground", "admin"))
    file = deployment(tmp_path, POSES + SAFE + f'[ledger]\nkind = "existing"\n{names}')
    with somebody_elses_drones(tmp_path, 1, "--battery", "12"):
        with somebody_elses_network(tmp_path) as organisations:
            code, checks = preflight(file)
            assert code == 1 and checks[None, "ledger"]["verdict"] == checks["tello1", "lease"]["verdict"] == "ok"
            assert "free" in checks["tello1", "lease"]["what"]
            users = organisations / "org2.ledgerline" / "users"
            certificate = next((users / "User2@org2.ledgerline" / "msp" / "signcerts").iterdir())
            control(tmp_path / "admin2.toml", "enroll", "--msp", "Org2MSP", "--cert", certificate, "--role", "operator")
            control(tmp_path / "other.toml", "acquire", "tello1")
            code, checks = preflight(file)
            wrong = {check for check, line in checks.items() if line["verdict"] == "broken"}
            assert code == 1 and wrong == {("tello1", "battery"), ("tello1", "lease")}, checks
            assert "12 %" in checks["tello1", "battery"]["what"] and "charge" in checks["tello1", "battery"]["cure"]
            assert "held by Org2MSP" in checks["tello1", "lease"]["what"] and "User2" in checks["tello1", "lease"]["what"]
            assert "ledgerline control request tello1" in checks["tello1", "lease"]["cure"]
            assert 85 < float(re.search(r"(\d+) a second", checks["tello1", "pose"]["what"])[1]) < 115 and "state texts" in checks["tello1", "state"]["what"]
            refused = refusal(tmp_path, file, 1)
            assert "tello1's lease: held by Org2MSP" in refused and "ledgerline control request tello1" in refused
        code, checks = preflight(file)
        assert code == 1 and checks[None, "ledger"]["verdict"] == "broken" and checks[None, "ledger"]["cure"]
        assert ("tello1", "lease") not in checks
        refused = refusal(tmp_path, deployment(tmp_path, POSES + SAFE), 1)
        assert "not ready: tello1's battery: 12 %" in refused and "Waiting for what is broken" not in refused, refused
    assert_nothing_left()


def refusal(tmp_path: pathlib.Path, file: pathlib.Path, code: int) -> str:
    assert fly(tmp_path, "--deployment", file).wait(90) == code, printed(tmp_path)
    return printed(tmp_path)


def test_what_is_wrong_in_the_file_is_reported_with_its_place(tmp_path):
    wrong = deployment(tmp_path, POSES + SAFE + "hieght_m = 2\n")
    assert "real.toml:9: fence.hieght_m: unknown key" in refusal(tmp_path, wrong, 2)
    assert "real drones are not flown without a fence" in refusal(tmp_path, deployment(tmp_path, POSES), 2)


def test_a_path_beyond_the_fence_does_not_take_off(tmp_path):
    file = deployment(tmp_path, POSES + SAFE + "[flight]\nside_m = 8\n")
    with somebody_elses_drones(tmp_path):
        assert re.search(r"tello1 would be at .* beyond link's fence", refusal(tmp_path, file, 1))
    assert_nothing_left()


def test_a_missing_drone_is_named(tmp_path):
    file = deployment(tmp_path, POSES + SAFE + "[flight]\nwait_s = 4\n", drones=2)
    with somebody_elses_drones(tmp_path, drones=1):
        text = refusal(tmp_path, file, 1)
    assert re.search(r"broken +drone +drone_silent: tello2: 127\.0\.0\.3", text), text
    error = text.split("not ready after 4 s: ")[1]
    assert "tello2's drone: 127.0.0.3: the drone does not answer" in error and "tello1" not in error
    assert_nothing_left()
