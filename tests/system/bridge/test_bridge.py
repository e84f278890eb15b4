"""ROS 2 on one side, the ledger between, ROS 2 on the other: bytes, order, latecomers, types that change, who may write."""
import os
import pathlib
import subprocess
import time

import made_up
import peers
import pytest
from conftest import BIN
from cyclone import Number, Reader, Text, Writer

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
HERE, THERE = 11, 12  # DDS domains


ANYBODY = 'from = "*"'


def topic(name: str, *more: str) -> str:
    return "\n".join(["[[topic]]", f'name = "{name}"', *more, ""])


def test_ten_thousand_messages_of_a_made_up_type(ledger, bridges, running, kind):
    count = 10_000 if LONG or (ledger.name, kind) == ("ledgerline-node", "cyclonedds") else 2_000
    carried = topic("/made_up", f'type = "{made_up.ROS_TYPE}"', "queue = 10000", ANYBODY)
    here = bridges(ledger, bridges.directory, 1, HERE, carried)
    there = bridges(ledger, bridges.directory, 2, THERE, carried)
    hears = running(peers.subscriber(kind, THERE, "/made_up", count))
    assert hears.line() == {"ready": True}
    says = running(peers.publisher(kind, HERE, "/made_up", 1, count, 1))
    assert hears.line()["number"] == 0
    says.go()
    got = []
    while len(got) < count:
        got += [line for line in [hears.line()] if line["number"] > 0]
    assert [one["number"] for one in got] == list(range(1, count + 1)), \
        f"{here.topic('/made_up', 'to_ledger')}\n{there.topic('/made_up', 'from_ledger')}"
    assert all(made_up.in_whole_words(one["cdr"]) == made_up.cdr(one["number"]) for one in got)
    up = here.wait_for("/made_up", "to_ledger", lambda t: t["messages"] == t["taken"] > count)
    down = there.wait_for("/made_up", "from_ledger", lambda t: t["messages"] >= up["messages"])
    print(f"\n{ledger.name}, {kind}: {up['messages']} messages in {up['batches']} transactions; ms from DDS to the ledger: "
          f"median {up['age_ms']['median']}, p99 {up['age_ms']['p99']}")
    assert up["messages"] == down["messages"] >= count + 1 and up["drops"] == {} and down["drops"] == {}
    assert here.topic("/made_up", "from_ledger")["drops"] == {"echo": up["messages"]}
    assert there.topic("/made_up", "to_ledger")["taken"] == 0, "nothing goes round"


def test_the_origins_time_is_what_readers_are_reported(embedded, bridges):
    carried = topic("/stamped", 'type = "std_msgs/msg/String"', ANYBODY)
    bridges(embedded, bridges.directory, 1, HERE, carried)
    bridges(embedded, bridges.directory, 2, THERE, carried)
    writer, reader = Writer(HERE, "/stamped", Text).wait_for_readers(), Reader(THERE, "/stamped", Text)
    long_ago = 1_700_000_000_000_000_000
    deadline = time.monotonic() + 60
    while not (taken := reader.take()):
        assert time.monotonic() < deadline
        writer.write(Text("old"), long_ago)
        time.sleep(0.05)
    assert taken[0].sample_info.source_timestamp == long_ago


def test_a_drones_topic_is_never_taken_by_a_star(embedded, bridges):
    """What another organisation wrote as Org1MSP/tello1/cmd_vel does not come out on the ground's domain by "/*"."""
    writer = Writer(HERE, "/tello1/cmd_vel", Text)
    note = Writer(HERE, "/tello1/note", Text)
    here = bridges(embedded, bridges.directory, 1, HERE, topic("/*", 'direction = "to_ledger"'))
    there = bridges(embedded, bridges.directory, 2, THERE, topic("/tello1/*", ANYBODY) + topic("/*", ANYBODY))
    heard = Reader(THERE, "/tello1/cmd_vel", Text)
    for one in (writer, note):
        one.wait_for_readers()
        one.write(Text("fly"))
    here.wait_for("/tello1/cmd_vel", "to_ledger", lambda t: t["messages"] == 1)
    there.wait_for("/tello1/note", "from_ledger", lambda t: t["messages"] == 1)
    held_back = there.wait_for("/tello1/cmd_vel", "from_ledger", lambda t: t["taken"] == 1)
    assert held_back["drops"] == {"unnamed": 1} and held_back["messages"] == 0
    assert heard.take() == []


def test_a_latched_value_is_there_for_who_comes_late(embedded, bridges):
    carried = topic("/map", 'type = "std_msgs/msg/String"', "latched = true", 'from = "Org1MSP"')
    here = bridges(embedded, bridges.directory, 1, HERE, carried)
    writer = Writer(HERE, "/map", Text, latched=True).wait_for_readers()
    for count, text in enumerate(("the old map", "the map"), 1):
        writer.write(Text(text))
        here.wait_for("/map", "to_ledger", lambda t, count=count: t["messages"] == count)
    there = bridges(embedded, bridges.directory, 2, THERE, carried)
    reader = Reader(THERE, "/map", Text, latched=True)
    assert [message.data for message in reader.take_all(1)] == ["the map"]
    writer.write(Text("a newer map"))
    assert [message.data for message in reader.take_all(1)] == ["a newer map"]
    assert [message.data for message in Reader(THERE, "/map", Text, latched=True).take_all(1)] == ["a newer map"]
    assert there.topic("/map", "from_ledger")["drops"] == {}


def test_topics_appear_change_their_type_and_vanish(embedded, bridges):
    here = bridges(embedded, bridges.directory, 1, HERE, topic("/some/*", ANYBODY))
    bridges(embedded, bridges.directory, 2, THERE, topic("/some/*", ANYBODY))
    writer = Writer(HERE, "/some/thing", Text).wait_for_readers()
    texts = Reader(THERE, "/some/thing", Text)
    while not texts.take():  # volatile: what came before our reader was known is gone
        writer.write(Text("a text"))
        time.sleep(0.05)
    del writer
    deadline = time.monotonic() + 60
    while "/some/thing: nobody writes std_msgs/msg/String any more" not in here.log():
        assert time.monotonic() < deadline, here.log()
        time.sleep(0.05)
    other = Writer(HERE, "/some/thing", Number).wait_for_readers()
    numbers = Reader(THERE, "/some/thing", Number)
    deadline = time.monotonic() + 60
    while not (taken := numbers.take()):
        assert time.monotonic() < deadline, here.log()
        other.write(Number(7))
        time.sleep(0.05)
    assert taken[0].data == 7
    here.wait_for("/some/thing", "to_ledger", lambda t: t["type"] == "std_msgs/msg/UInt64")


@pytest.mark.parametrize("ledger", ["fabric"], indirect=True)  # the embedded node has one channel
def test_a_topic_may_have_a_channel_of_its_own(ledger, bridges):
    anchor = f'config_block = "{ledger.directory}/yard.block"'
    carried = topic("/map", 'type = "std_msgs/msg/String"', 'channel = "yard"', anchor, ANYBODY) + topic("/*", ANYBODY)
    here, there = (bridges(ledger, bridges.directory, organisation, domain, carried)
                   for organisation, domain in ((1, HERE), (2, THERE)))
    for name in ("/map", "/note"):
        writer, reader = Writer(HERE, name, Text).wait_for_readers(), Reader(THERE, name, Text)
        while not (taken := reader.take()):
            writer.write(Text(name))
            time.sleep(0.05)
        assert taken[0] == Text(name)
    for bridge, direction in ((here, "to_ledger"), (there, "from_ledger")):
        bridge.wait_for("/note", direction, lambda t: t["messages"] > 0)
        assert {channel["channel"]: {t["topic"] for t in channel["topics"] if t["direction"] == direction}
                for channel in bridge.status()["channels"]} == {"yard": {"/map"}, "teleop": {"/note"}}


def test_who_may_not_write_a_topic_does_not_get_through(embedded, bridges):
    """tello1 is enrolled to Org1's User1."""
    carried = topic("/tello1/note", 'type = "std_msgs/msg/String"', ANYBODY)
    reader_bridge = bridges(embedded, bridges.directory, 3, THERE, carried)
    thief = bridges(embedded, bridges.directory, 2, HERE, '[[enrolled]]\nname = "tello1"\n' + carried)
    reader = Reader(THERE, "/tello1/note", Text)
    writer = Writer(HERE, "/tello1/note", Text).wait_for_readers()
    writer.write(Text("I am tello1"))
    thief.wait_for("/tello1/note", "to_ledger", lambda t: t["drops"] == {"refused": 1})
    assert "tello1: enrolled to Org1MSP" in thief.log()
    assert reader_bridge.topic("/tello1/note", "from_ledger") is None and reader.take() == []
    owner = bridges(embedded, bridges.directory, 1, 13, '[[enrolled]]\nname = "tello1"\n' + carried)
    rightful = Writer(13, "/tello1/note", Text).wait_for_readers()
    deadline = time.monotonic() + 60
    while not (taken := reader.take()):
        assert time.monotonic() < deadline, owner.log()
        rightful.write(Text("it is me"))
        time.sleep(0.05)
    assert taken[0].data == "it is me"


def test_streaming_topics_are_one_key_whose_values_get_says(embedded, bridges):
    carried = '[[enrolled]]\nname = "tello2"\n' + topic("/tello2/*", "stream = true", 'direction = "to_ledger"')
    here = bridges(embedded, bridges.directory, 1, HERE, carried)
    writers = [Writer(HERE, f"/tello2/{name}", Text).wait_for_readers() for name in ("a", "b")]
    for writer, text in ((writers[0], "one"), (writers[1], "two"), (writers[0], "three")):
        writer.write(Text(text))
        time.sleep(0.1)
    here.wait_for("/tello2/a", "to_ledger", lambda t: t["messages"] == 2)
    there = bridges(embedded, bridges.directory, 2, THERE,
                    topic("/tello2/*", "latched = true", 'direction = "from_ledger"', 'from = "tello2"'))
    values = {there.topic(f"/tello2/{name}", "from_ledger")["messages"] for name in ("a", "b")}
    assert values == {1}
    assert [m.data for m in Reader(THERE, "/tello2/a", Text, latched=True).take_all(1)] == ["three"]
    assert [m.data for m in Reader(THERE, "/tello2/b", Text, latched=True).take_all(1)] == ["two"]


def test_it_ends_in_order_and_says_what_is_wrong(embedded, bridges, tmp_path):
    bridge = bridges(embedded, bridges.directory, 1, HERE, topic("/a", 'type = "std_msgs/msg/String"', ANYBODY))
    writer = Writer(HERE, "/a", Text).wait_for_readers()
    for _ in range(50):
        writer.write(Text("x"))
    time.sleep(0.2)
    bridge.stop()
    table = subprocess.run([BIN / "ledgerline", "topics", "--once", bridge.status_file], capture_output=True, text=True)
    assert table.returncode == 0 and "/a" in table.stdout, table.stderr
    assert " 50 " in table.stdout, "all that it had taken is on the ledger"
    time.sleep(1.5)
    table = subprocess.run([BIN / "ledgerline", "topics", "--once", bridge.status_file], capture_output=True, text=True)
    assert table.returncode == 1 and "is it running?" in table.stderr
    assert '/a is taken from the ledger from any writer: its [[topic]] says from = "*"' in bridge.log()
    wrong = pathlib.Path(tmp_path / "wrong.toml")
    wrong.write_text('[[topic]]\nname = "a"\n')
    done = subprocess.run([BIN / "ledgerline", "bridge", wrong], capture_output=True, text=True)
    assert done.returncode == 2 and "wrong.toml:2: topic.0.name" in done.stderr, done.stderr
    shown = subprocess.run([BIN / "ledgerline", "bridge", "--help"], capture_output=True, text=True)
    assert shown.returncode == 0 and len(shown.stdout.splitlines()) < 40 and "Exit codes" in shown.stdout
