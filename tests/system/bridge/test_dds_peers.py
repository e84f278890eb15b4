"""The bridge's DDS side and implementations of ROS 2 and DDS that know nothing of it: both ways, the bytes equal, and the
node listed."""
import os
import pathlib

import made_up
import peers

BIN = pathlib.Path(os.environ["LEDGERLINE_BIN"])
COUNT = 1000
DOMAIN = 7


def test_messages_of_an_unknown_type_go_through_with_their_bytes(running, kind):
    hears = running(peers.subscriber(kind, DOMAIN, "/made_up/out", COUNT))
    assert hears.line() == {"ready": True}
    through = running(peers.Peer([BIN / "raw_dds", made_up.ROS_TYPE, "/made_up/in", "/made_up/out"], DOMAIN))
    assert through.line() == {"ready": True}
    says = running(peers.publisher(kind, DOMAIN, "/made_up/in", 1, COUNT, 1))
    assert hears.line()["number"] == 0
    says.go()

    got = []
    while len(got) < COUNT:
        got += [line for line in [hears.line()] if line["number"] > 0]
    want = [made_up.cdr(n) for n in range(1, COUNT + 1)]
    assert [one["number"] for one in got] == list(range(1, COUNT + 1))
    assert [made_up.in_whole_words(one["cdr"]) for one in got] == want
    through.end_input()
    *passed, counted = through.lines_until("malformed")
    assert [made_up.in_whole_words(one["cdr"]) for one in passed][-COUNT:] == want
    assert all(one["said"] for one in passed)
    assert counted == {"malformed": 0, "lost": 0}


def test_the_node_is_listed(running, kind):
    sees = running(peers.nodes(kind, DOMAIN, "/raw_dds"))
    assert sees.line() == {"ready": True}
    running(peers.Peer([BIN / "raw_dds", made_up.ROS_TYPE, "/made_up/in", "/made_up/out"], DOMAIN))
    while sees.line()["node"] != "/raw_dds":
        pass
