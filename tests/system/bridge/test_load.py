"""Under load: what comes through, what is dropped by rule, what a joystick feels of an image beside it. Figures are printed;
what is asserted is that nothing goes astray uncounted."""
import json
import os
import pathlib
import subprocess
import sys

import pytest
from conftest import TIMEOUT_S
from running import cpu_s

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
LOAD = pathlib.Path(__file__).with_name("load.py")
# DDS keeps what the bridge has not taken yet, however late it gets its turn: so none is lost uncounted before it.
TEXT = 'type = "std_msgs/msg/String"\ndepth = 5000'


def load(*words) -> subprocess.Popen:
    return subprocess.Popen([sys.executable, LOAD, *map(str, words)], stdout=subprocess.PIPE, text=True)


def result(process: subprocess.Popen) -> dict:
    out, _ = process.communicate(timeout=TIMEOUT_S)
    assert process.returncode == 0
    return json.loads(out) if out else {}


def topics(*rules: str) -> str:
    return "".join(f"[[topic]]\n{rule}\n" for rule in rules)


def settled(bridge) -> list[dict]:
    """Its topics to the ledger, once nothing is on its way."""
    names = [t["topic"] for t in bridge.status()["channels"][0]["topics"] if t["direction"] == "to_ledger"]
    return [bridge.wait_for(name, "to_ledger", lambda t: t["pending"] == 0) for name in names]


def test_many_small_messages_over_twenty_topics(ledger, bridges):
    rate, seconds = (2_000 if ledger.name == "ledgerline-node" else 1_000), (30 if LONG else 5)
    up_rules = topics(*(f'name = "/load/t{k}"\n{TEXT}\ndirection = "to_ledger"' for k in range(20)))
    here = bridges(ledger, bridges.directory, 1, 21, up_rules)
    there = bridges(ledger, bridges.directory, 2, 22, topics('name = "/load/*"\ndirection = "from_ledger"\nfrom = "Org1MSP"'))
    before = cpu_s(here.process.pid), cpu_s(there.process.pid)
    written = result(load("write", 21, 20, rate, seconds, 100))
    up = settled(here)
    used = cpu_s(here.process.pid) - before[0], cpu_s(there.process.pid) - before[1]
    down = [there.wait_for(t["topic"], "from_ledger", lambda d, t=t: d["taken"] >= t["messages"]) for t in up]
    taken, on_ledger = sum(t["taken"] for t in up), sum(t["messages"] for t in up)
    drops = sum(sum(t["drops"].values()) for t in up)
    transactions = max(t["batches"] for t in up)
    ages = sorted(t["age_ms"]["p99"] for t in up)
    print(f"\n{ledger.name}: {written['written'] / written['seconds']:.0f} messages/s written over 20 topics for "
          f"{written['seconds']:.1f} s: {taken} taken off DDS, {on_ledger} on the ledger in about {transactions} transactions, "
          f"{drops} dropped by rule; p99 of age {ages[0]:.1f} to {ages[-1]:.1f} ms; CPU per message up "
          f"{1e6 * used[0] / taken:.0f} us, down {1e6 * used[1] / taken:.0f} us, whole processes")
    assert taken == written["written"] == on_ledger + drops
    assert sum(t["messages"] for t in down) == on_ledger
    assert sum(t["missing"] for t in down) == drops


def test_beyond_what_it_can_carry_the_low_priority_loses_its_oldest(embedded, bridges):
    """Ten calls a second of at most 128 kB, 2,000 messages a second of 1 kB."""
    here = bridges(embedded, bridges.directory, 1, 21, topics(
        f'name = "/load/t0"\n{TEXT}\npriority = 9\ndirection = "to_ledger"',
        f'name = "/load/*"\n{TEXT}\npriority = 1\nqueue = 50\ndirection = "to_ledger"'), options="min_gap_ms = 100\n")
    result(load("write", 21, 20, 2_000, 3, 1_000))
    first, *others = sorted(settled(here), key=lambda t: t["topic"])
    print(f"\n{first['topic']}: {first['drops']}; the others: {[t['drops'] for t in others]}")
    assert first["topic"] == "/load/t0" and first["drops"] == {} and first["messages"] == first["taken"] == 300
    for topic in others:
        assert topic["drops"].keys() == {"overflow"} and topic["taken"] == 300
        assert topic["messages"] == 300 - topic["drops"]["overflow"]


@pytest.mark.parametrize("size", [300_000])
def test_a_joystick_beside_images(ledger, bridges, size):
    seconds = 60 if LONG else 8
    rules = topics('name = "/load/joy"\ntype = "std_msgs/msg/UInt64"\npriority = 9\nfrom = "*"',
                   f'name = "/load/image"\ntype = "std_msgs/msg/String"\npriority = 1\nqueue = 2\ndirection = "to_ledger"')
    here = bridges(ledger, bridges.directory, 1, 21, rules)
    bridges(ledger, bridges.directory, 2, 22, rules)
    alone = result(load("joystick", 21, 22, seconds))
    stick = load("joystick", 21, 22, seconds)
    neighbour = load("images", 21, 10, seconds + 4, size)
    beside = result(stick)
    result(neighbour)
    image = settled(here)
    print(f"\n{ledger.name}: joystick at 50 Hz, ms from DDS to DDS: alone {alone}, beside images of {size} bytes at 10 Hz "
          f"{beside}\n{[t for t in image if t['topic'] == '/load/image'][0]}")
    for figures in (alone, beside):
        assert figures["came"] == figures["written"]
