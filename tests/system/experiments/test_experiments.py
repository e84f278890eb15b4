"""`ledgerline experiment` end to end: a real flight, its JSON, its verdicts, its page."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import time

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])


def experiment(*words) -> subprocess.CompletedProcess:
    return subprocess.run([BIN / "ledgerline", "experiment", *map(str, words)], capture_output=True, text=True, timeout=300)


def test_one_experiment_from_flight_to_page_and_once_more_from_what_is_kept(tmp_path):
    asked = ("latency", "--quick", "--case", "square", "--out", tmp_path)
    done = experiment(*asked)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads((tmp_path / "latency.json").read_text())
    assert document["asked"]["ledger"] == "embedded" and document["asked"]["quick"] and list(document["cases"]) == ["square"]
    assert document["machine"]["cores"] >= 1 and document["not_measured"] == []
    (flight,) = document["cases"]["square"]
    figures = flight["figures"]
    assert 0 < figures["two_way_ms.q1"] <= figures["two_way_ms.median"] <= figures["two_way_ms.q3"] <= figures["two_way_ms.max"]
    assert figures["finished"] == 1 and 0 < figures["rms_m"] < figures["max_m"]
    assert flight["ledger"]["batch_count"] == 1 and flight["ledger"]["storage"]
    assert len(flight["tracks"]["tello1"]["flown"]) > 100 and len(flight["profile"]["virtual"]) > 100
    verdicts = {bar["what"]: bar for bar in document["bars"]}
    assert verdicts["every flight finishes its path"]["verdict"] == "kept"
    (fifteen,) = [bar for what, bar in verdicts.items() if "fifteen" in what]
    assert fifteen["verdict"] == "not measured" and "fabric" in fifteen["note"]
    assert fifteen["values"]["low"] == min(1e3 * box / own for box, own in zip(
        (0.396, 0.456, 0.525), (figures[f"two_way_ms.{q}"] for q in ("q1", "median", "q3"))))

    page = (tmp_path / "report.html").read_text()
    assert page.count('src="data:image/png;base64,') == 3, "boxes, paths, speeds"
    assert not re.findall(r'(?:src|href)="(?!data:|#)', page), "it opens without a network"
    assert "350 to 400 ms" in page and "0.55 s" in page and "fifteen times" in page
    assert (tmp_path / "experiments.png").stat().st_size > 5_000
    assert not (tmp_path / "running").exists()

    (tmp_path / "old.json").write_text('{"experiment": "old"}')
    again = experiment(*asked)
    assert "old.json: no experiment of this version" in again.stderr
    assert again.returncode == 0 and "square, seed 1" in again.stdout and "kept from before" in again.stdout
    assert json.loads((tmp_path / "latency.json").read_text())["cases"] == document["cases"]


def test_what_is_asked_wrongly_is_named(tmp_path):
    for words, named in ((("nothing",), "nothing"), (("latency", "--case", "circle"), "circle"),
                         (("latency", "--seeds", "0"), "--seeds")):
        done = experiment(*words, "--out", tmp_path)
        assert done.returncode == 2 and named in done.stderr, done.stderr


def test_what_is_asked_wrongly_installs_nothing(tmp_path):
    root = pathlib.Path(__file__).resolve().parents[3]
    for part in ("scripts/experiment", "scripts/setup.sh", "common/page/style.css"):
        (tmp_path / part).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(root / part, tmp_path / part)
    shutil.copytree(root / "tools/experiments", tmp_path / "tools/experiments", ignore=shutil.ignore_patterns("__pycache__"))
    done = subprocess.run([tmp_path / "scripts/experiment", "nosuch"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "nosuch" in done.stderr and "latency" in done.stderr, done.stderr
    assert not (tmp_path / "build").exists()


def test_what_cannot_be_measured_is_no_success(tmp_path):
    """The published client needs its packages."""
    done = subprocess.run([BIN / "ledgerline", "experiment", "events", "--quick", "--out", tmp_path], capture_output=True,
                          text=True, timeout=300, env={**os.environ, "LEDGERLINE_NPM": "/nowhere", "LEDGERLINE_BIN": str(tmp_path)})
    assert done.returncode == 1
    assert "ledgerline is not built" in done.stdout and "Traceback" not in done.stderr
    assert json.loads((tmp_path / "events.json").read_text())["not_measured"][0]["case"] == "our settings"


def test_an_interrupt_lets_the_flight_land_first(tmp_path):
    """The flight is a script that only looks like fly: it notes its arguments."""
    programs, out = tmp_path / "bin", tmp_path / "out"
    programs.mkdir()
    (programs / "ledgerline").write_text(f"#!/bin/sh\ntrap 'sleep 0.5; echo landed > {tmp_path}/landed; exit 1' INT\n"
                                             f"touch {tmp_path}/flies\nwhile :; do sleep 0.05; done\n")
    (programs / "ledgerline").chmod(0o755)
    process = subprocess.Popen([BIN / "ledgerline", "experiment", "latency", "--quick", "--case", "square", "--out", out],
                               stdout=subprocess.PIPE, text=True, env={**os.environ, "LEDGERLINE_BIN": str(programs)})
    deadline = time.monotonic() + 60
    while not (tmp_path / "flies").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    printed, _ = process.communicate(timeout=60)
    assert process.returncode == 1 and "interrupted" in printed
    assert (tmp_path / "landed").read_text() == "landed\n"
    assert not (out / "running").exists() and (out / "report.html").exists()
