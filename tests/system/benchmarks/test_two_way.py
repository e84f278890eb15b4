"""`ledgerline bench two-way`: the clients exchange messages, and its JSON has what its table says."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import time

import pytest
from fabric import FABRIC, needs_fabric

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
NPM = pathlib.Path(os.environ["LEDGERLINE_NPM"])


def needs_node() -> None:
    if shutil.which("node") is None or not (NPM / "node_modules" / "@hyperledger" / "fabric-gateway").is_dir():
        pytest.skip("the official Node.js client is missing: ./run-tests installs it")


def bench(*options, programs: pathlib.Path = BIN) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / "ledgerline", "bench", "two-way", "--npm", NPM, "--fabric", FABRIC, *map(str, options)],
                          capture_output=True, text=True, timeout=250, env={**os.environ, "LEDGERLINE_BIN": str(programs)})


def measure(directory: pathlib.Path, *options, drain: float = 60, programs: pathlib.Path = BIN) -> tuple[dict, str]:
    file, place = directory / "two-way.json", directory / "ledgers"
    done = bench("--json", file, "--dir", place, "--drain", drain, *options, programs=programs)
    assert done.returncode == 0, done.stderr
    assert not any(place.iterdir()), "something was left behind"
    return json.loads(file.read_text()), done.stdout


def rows(table: str) -> list[list[float]]:
    """The figures at the end of each line that has all of them; none ("-") is left out."""
    found = [re.findall(r"(?<!\S)(?:\d+(?:\.\d+)?|-)(?!\S)", line)[-8:] for line in table.splitlines()]
    return [[float(one) for one in row if one != "-"] for row in found if len(row) == 8]


def check(result: dict, table: str, rate: int, seconds: float) -> None:
    """Every message of the measured time is accounted for, raw and summed up alike."""
    for run in result["runs"]:
        assert run["sent"] == rate / 2 * seconds
        assert run["sent"] == run["answered"] + run["replaced"], {what: run[what] for what in run if what != "latencies_ms"}
        assert run["answered"] > 0
        assert len(run["latencies_ms"]) == run["sent"]
        assert min(run["latencies_ms"]) <= run["p50_ms"] <= run["p99_ms"] <= max(run["latencies_ms"])
        assert 0 < run["cpu_s"] and 0 < run["ledger_cpu_s"] and not run["collapsed"]
        (figures,) = [f for f in result["summary"]["figures"] if f["client"] == run["client"]]
        assert figures["p50_ms"]["median"] == pytest.approx(run["p50_ms"], abs=1e-3)
        raw = [run[what] for what in ("p50_ms", "p99_ms", "cpu_ms_per_message", "ledger_cpu_ms_per_message")] + [run[what] for what in ("sent", "answered", "replaced", "lost")]
        raw = [one for one in raw if one is not None]  # no CPU of an answer where a starved machine gave none in time
        assert any(row == pytest.approx(raw, rel=0.01, abs=0.01) for row in rows(table)), (raw, table)
    for ratios in result["summary"]["ratios"]:
        theirs, ours = ([run for run in result["runs"] if run["client"] == client] for client in (ratios["against"], ratios["client"]))
        assert ratios["p50"]["median"] == pytest.approx(ours[0]["p50_ms"] / theirs[0]["p50_ms"], abs=1e-3)


def test_every_client_exchanges_messages(tmp_path):
    needs_node()
    clients = ["gateway", "direct", "polling", "ledgerline", "ledgerline-mbedtls",
               "ledgerline-validated", "ledgerline-ordered"]
    result, table = measure(tmp_path, "--ledger", "embedded", "--rates", 40, "--clients", ",".join(clients),
                            "--alternations", 1, "--seconds", 1, "--warm-up", 1)
    assert [run["client"] for run in result["runs"]] == clients
    assert [(ratios["client"], ratios["against"]) for ratios in result["summary"]["ratios"]] == [
        (ours, against) for ours in clients[3:] for against in clients[:4] if ours != against]
    assert result["ledger"]["storage"] in table
    check(result, table, 40, 1)


def test_on_fabric_with_the_published_settings_and_ours(tmp_path):
    needs_node()
    needs_fabric()
    result, table = measure(tmp_path, "--rates", 40, "--clients", "published,ledgerline", "--alternations", 1,
                            "--seconds", 1, "--warm-up", 1)
    networks = result["ledger"]["networks"]
    assert [(n["orderers"], n["batch_count"], n["batch_timeout_ms"]) for n in networks] == [(3, 10, 2000), (1, 1, 10)]
    assert networks[0]["transactions"] > 2 * networks[0]["blocks"]
    check(result, table, 40, 1)


def test_every_other_alternation_is_in_reverse_order(tmp_path):
    result, _ = measure(tmp_path, "--ledger", "embedded", "--rates", 40, "--clients", "ledgerline,ledgerline-mbedtls",
                        "--alternations", 2, "--seconds", 0.5, "--warm-up", 0)
    assert [run["client"] for run in result["runs"]] == ["ledgerline", "ledgerline-mbedtls", "ledgerline-mbedtls", "ledgerline"]
    assert [run["position"] for run in result["runs"]] == [0, 1, 0, 1]


def test_a_client_that_never_ends_is_ended_and_reported(tmp_path):
    programs = tmp_path / "bin"
    programs.mkdir()
    for program in BIN.iterdir():
        (programs / program.name).symlink_to(program)
    (programs / "two_way_client").unlink()
    (programs / "two_way_client").write_text(
        "#!/bin/sh\necho \"{\\\"ready\\\":true,\\\"pid\\\":$$}\"\n"
        "echo '{\"progress\":{\"sent\":10,\"answered\":3}}'\nexec sleep 1000\n")
    (programs / "two_way_client").chmod(0o755)
    result, table = measure(tmp_path, "--ledger", "embedded", "--rates", 40, "--clients", "ledgerline", "--alternations", 1,
                            "--seconds", 0.5, "--warm-up", 0, drain=0.5, programs=programs)
    (run,) = result["runs"]
    assert run["timed_out"] and run["collapsed"] and (run["sent"], run["answered"], run["lost"]) == (10, 3, 7)
    assert "collapsed 1 of 1" in table


def test_an_interrupt_keeps_what_was_measured_and_leaves_nothing_behind(tmp_path):
    file, place = tmp_path / "two-way.json", tmp_path / "ledgers"
    process = subprocess.Popen(
        [BIN / "ledgerline", "bench", "two-way", "--ledger", "embedded", "--rates", "40", "--clients", "ledgerline", "--seconds", "0.5",
         "--warm-up", "0", "--alternations", "1000", "--json", file, "--dir", place], stdout=subprocess.PIPE, text=True)
    for _ in range(600):
        if file.exists():
            break
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    table, _ = process.communicate(timeout=60)
    assert process.returncode == 1 and "Ledgerline, libcrypto" in table
    assert json.loads(file.read_text())["runs"]
    assert not any(place.iterdir())


@pytest.mark.parametrize("options, code, words", [
    (["--rates", "0"], 2, "--rates"),
    (["--clients", "nobody"], 2, "--clients"),
    (["--npm", "/nowhere", "--clients", "gateway"], 1, "/nowhere/node_modules"),
    (["--fabric", "/nowhere", "--clients", "ledgerline"], 1, "scripts/fabric-tools"),
    (["--network=--no-history", "--clients", "ledgerline", "--ledger", "embedded"], 1, "knows no --no-history"),
    (["--dir", "/proc", "--clients", "ledgerline", "--ledger", "embedded"], 1, "/proc is not empty"),
])
def test_what_is_wrong_is_named(options, code, words):
    command = [BIN / "ledgerline", "bench", "two-way", *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    assert done.returncode == code
    assert words in done.stderr + done.stdout


def test_a_client_that_is_not_built_is_named_with_its_target(tmp_path):
    done = bench("--clients", "ledgerline", "--ledger", "embedded", programs=tmp_path)
    assert done.returncode == 1
    assert f"two_way_client is not built: ninja -C {BIN.resolve().parent} two_way_client" in done.stderr + done.stdout
