"""link on a clock that hil moves: the same bytes however fast, and whatever the computer does meanwhile."""
import os
import signal
import time

import pytest
from shim import SCRIPT, fly

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
FAULTS = """
[[fault]]
at_s = 0
for_s = 10
do = "sdk tello1 answers late 300ms"
[[fault]]
at_s = 6
for_s = 2
do = "sdk tello1 states torn 30%"
[[fault]]
at_s = 6
for_s = 1
do = "drone tello1 to loss 20%, delay 30ms"
"""


def halt_and_hinder(hil, link) -> None:
    """The clock stands a second, then link does, then it goes on."""
    time.sleep(0.3)
    hil.send_signal(signal.SIGUSR1)
    time.sleep(1)
    hil.send_signal(signal.SIGUSR1)
    time.sleep(0.1)
    link.send_signal(signal.SIGSTOP)
    time.sleep(0.5)
    link.send_signal(signal.SIGCONT)


def test_the_same_bytes_however_fast(tmp_path):
    flown = {times: fly(tmp_path / f"at-{times}", SCRIPT + FAULTS, lockstep=times) for times in (["0.1"] if LONG else []) + ["1", "10", "free"]}
    flown["hindered"] = fly(tmp_path / "hindered", SCRIPT + FAULTS, lockstep="2", meanwhile=halt_and_hinder)
    first = flown["10"]
    assert first.summary["sdk"]["answers_late"] > 0 and first.summary["sdk"]["states_torn"] > 0, first.summary["sdk"]
    assert ("flying", "hold", "plan_ran_out") in first.transitions("tello1")
    assert first.transitions("tello1")[-1][0] == "landed"
    assert any(text.startswith("rc ") and text != "rc 0 0 0 0" for _, _, text in first.reported)
    for times, other in flown.items():
        assert other.reported == first.reported, times
        assert other.summary["sent_digest"] == first.summary["sent_digest"], times
        assert other.link["loop"]["cycles"] == first.link["loop"]["cycles"], times
    # A digest that says the same of everything would be no proof.
    other_script = fly(tmp_path / "another", SCRIPT.replace("0.4, 0.1", "0.4, 0.2") + FAULTS, lockstep="free")
    assert other_script.summary["sent_digest"] != first.summary["sent_digest"]


@pytest.mark.parametrize("who", ["hil", "link"])
def test_neither_waits_for_the_other_that_is_gone(tmp_path, who):
    begun = time.monotonic()

    def kill(hil, link) -> None:
        time.sleep(1)
        (hil if who == "hil" else link).kill()
        if who == "hil":
            assert link.wait(30) is not None

    with pytest.raises(AssertionError) as failed:
        fly(tmp_path / who, SCRIPT, lockstep="1", meanwhile=kill)
    assert time.monotonic() - begun < 60
    if who == "link":
        assert "link has ended" in str(failed.value)
