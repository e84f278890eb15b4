"""Pages that programs write, opened in a browser: nothing in them throws, and they show what they are about."""
import pathlib
import re
import subprocess

import pytest
from flights import fly, no_flight_outlives_its_test, printed
from programs import BIN


def ledgerline(*words) -> None:
    done = subprocess.run([BIN / "ledgerline", *map(str, words)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr


MEASURE = '''<script>document.title = "wide:" + [...document.querySelectorAll(".scroll")].filter(one => one.scrollWidth > one.clientWidth)
  .map(one => one.firstElementChild.id);</script></body>'''


def shown(page: pathlib.Path, width: int = 1200) -> str:
    """The page as its scripts have made it."""
    done = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=3000",
                           f"--window-size={width},900", f"--user-data-dir={page.parent}/browser", "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=120)
    said = [line for line in done.stderr.splitlines() if ":CONSOLE" in line]
    assert done.returncode == 0 and not said, said
    return done.stdout


@pytest.mark.essential
def test_the_page_of_fault_runs(tmp_path):
    ledgerline("fault", "run", "ledger-stall", "--seeds", "1..2", "--html", tmp_path / "fault.html")
    assert "rules held" in shown(tmp_path / "fault.html")


def test_the_pages_of_a_flight(tmp_path):
    flight = fly(tmp_path, "--laps", "1", "--side", "0.5")
    assert flight.wait(120) == 0, printed(tmp_path)
    run = tmp_path / "run"
    assert "Flown path" in shown(run / "report.html")
    ledgerline("timing", run, "--html", tmp_path / "timing.html")
    assert "sent" in shown(tmp_path / "timing.html")
    ledgerline("audit", "--blocks", run, "--anchor", run / "ledger" / "teleop.block", "--html", tmp_path / "audit.html")
    audit = shown(tmp_path / "audit.html")
    (tmp_path / "measured.html").write_text((tmp_path / "audit.html").read_text().replace("</body>", MEASURE))
    for width in (1200, 1600):
        assert "<title>wide:</title>" in shown(tmp_path / "measured.html", width), "what is cut: ids are to be read"
    assert re.search(r'<polyline points="[^" ]*,160 ', audit), "no commands before the first: 0"
    assert re.search(r'id="plotted"><span><i[^>]*></i>tello1</span>', audit), "whose line it is"
    assert re.search(r"<td[^>]*>landing</td>.*?<td[^>]*>[0-9a-f]{64}</td>", audit), "a transaction's id"
