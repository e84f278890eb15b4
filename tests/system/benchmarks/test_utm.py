"""`ledgerline bench utm`: both clients register the same intents, and each intent has one end."""
import json
import os
import pathlib
import subprocess

import pytest
from fabric import FABRIC, needs_fabric
from test_two_way import needs_node

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
NPM = pathlib.Path(os.environ["LEDGERLINE_NPM"])


def measure(directory: pathlib.Path, *options) -> tuple[dict, str]:
    file, place = directory / "utm.json", directory / "ledgers"
    done = subprocess.run([BIN / "ledgerline", "bench", "utm", "--npm", NPM, "--fabric", FABRIC, "--json", file, "--dir", place, "--drain", "60",
                           "--alternations", "1", *map(str, options)], capture_output=True, text=True, timeout=250)
    assert done.returncode == 0, done.stderr
    assert not any(place.iterdir()), "something was left behind"
    return json.loads(file.read_text()), done.stdout


def check(result: dict, table: str) -> None:
    runs = result["runs"]
    assert len({run["submitted"] for run in runs}) == 1, "not the same intents"
    for run in runs:
        assert run["submitted"] == run["registered"] + run["refused"], {what: run[what] for what in run if what != "latencies_ms"}
        assert len(run["latencies_ms"]) == run["registered"] > 0
        assert min(run["latencies_ms"]) <= run["p50_ms"] <= run["p95_ms"] <= run["p99_ms"] <= max(run["latencies_ms"])
        assert run["lost"] == 0 and run["registered_per_s"] > 0 and not run["timed_out"]
        # One that was invalid was tried again, until it was told that the airspace is taken.
        assert run["conflicts"] >= run["retried"]
        (figures,) = [f for f in result["summary"] if (f["client"], f["settings"]) == (run["client"], run["settings"])]
        assert figures["p50_ms"]["median"] == pytest.approx(run["p50_ms"])
        assert (figures["refused"], figures["conflicts"]) == (run["refused"], run["conflicts"])
    assert "arXiv 2511.02171" in table and "more than 3 s" in table


def test_who_comes_second_is_refused_and_who_comes_at_once_conflicts(tmp_path):
    needs_node()
    result, table = measure(tmp_path, "--ledger", "embedded", "--rates", 40, "--settings", "ours", "--seconds", 2, "--warm-up", 1,
                            "--overlapping", 0.5)
    assert [run["client"] for run in result["runs"]] == ["gateway", "ledgerline"]
    check(result, table)
    assert all(run["refused"] > 0 for run in result["runs"])
    # Of races some transactions meet in the ledger.
    assert sum(run["conflicts"] for run in result["runs"]) > 0


def test_without_overlaps_everything_is_registered(tmp_path):
    result, table = measure(tmp_path, "--ledger", "embedded", "--rates", 30, "--settings", "ours", "--clients", "ledgerline", "--seconds", 1,
                            "--warm-up", 0, "--overlapping", 0)
    check(result, table)
    (run,) = result["runs"]
    assert (run["refused"], run["conflicts"]) == (0, 0)


def test_on_fabric_a_block_that_waits_for_two_seconds_is_most_of_the_latency(tmp_path):
    needs_node()
    needs_fabric()
    result, table = measure(tmp_path, "--rates", 30, "--seconds", 2, "--warm-up", 1)
    networks = result["ledger"]["networks"]
    assert [(n["settings"], n["orderers"], n["batch_count"], n["batch_timeout_ms"]) for n in networks] == [
        ("ours", 1, 1, 10), ("stock", 1, 500, 2000)]
    p50 = {(run["settings"], run["client"]): run["p50_ms"] for run in result["runs"]}
    for client in ("gateway", "ledgerline"):
        assert p50["stock", client] > 500, p50  # from 0 to 2 s until the block is cut
        check({**result, "runs": [run for run in result["runs"] if run["client"] == client]}, table)


@pytest.mark.parametrize("options, code, words", [
    (["--rates", "0"], 2, "--rates"),
    (["--clients", "nobody"], 2, "--clients"),
    (["--settings", "slow"], 2, "--settings"),
    (["--overlapping", "2"], 2, "--overlapping"),
    (["--npm", "/nowhere"], 1, "/nowhere/node_modules"),
])
def test_what_is_wrong_is_named(options, code, words):
    done = subprocess.run([BIN / "ledgerline-bench", "utm", *options], capture_output=True, text=True, timeout=20)
    assert done.returncode == code
    assert words in done.stderr + done.stdout
