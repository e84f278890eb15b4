"""djitellopy 2.5.0 as it comes from PyPI flies a simulated drone through the proxy."""
import math
import os
import time

import pytest

from proxies import tell

LONG = os.environ.get("LEDGERLINE_LONG") == "1"
FRONT, SOURCE = "10.77.3.2", "10.77.4.1"


@pytest.fixture
def sky(drones, proxies):
    """A drone, and a proxy before it in the same namespace, that the client in another one knows only by the proxy."""
    sim = drones(1)
    for address in (FRONT, SOURCE):
        sim.sky.run("ip", "addr", "add", f"{address}/32", "dev", "lo")
    proxy = proxies(drones=[("tello1", FRONT, sim.hosts[0])], source=SOURCE, command=sim.sky.command)
    return sim, proxy


def steer(tello, left_right: int, forward: int, seconds: float) -> None:
    for _ in range(round(20 * seconds)):
        tello.send_rc_control(left_right, forward, 0, 0)
        time.sleep(0.05)


def test_it_flies_with_and_without_delay_loss_reordering_and_duplicates(sky):
    sim, proxy = sky

    def client():
        from djitellopy import Tello
        tello = Tello(FRONT)
        tello.connect()
        assert tello.get_battery() > 95
        tello.takeoff()
        begin = time.monotonic()
        assert tello.query_battery() > 90
        quick_s = time.monotonic() - begin

        tell(proxy.socket, "drone tello1 both delay 200ms")
        begin = time.monotonic()
        assert tello.query_battery() > 90
        slow_s = time.monotonic() - begin
        print(f"an answer after {quick_s:.3f} s, with 200 ms each way {slow_s:.3f} s")
        assert quick_s < 0.4 <= slow_s  # the client looks for answers ten times a second
        tello.move_forward(80)

        # rc is never answered, so what is lost of it and of the state is not asked for again. Both go by the proxy's seed.
        tell(proxy.socket, "drone tello1 to delay 200ms, loss 5%, reorder 10% 60ms, duplicate 10% 30ms")
        tell(proxy.socket, "drone tello1 state delay 200ms, loss 5%, reorder 10% 150ms, duplicate 10% 120ms")
        steer(tello, 0, 40, 1.5)
        steer(tello, 0, -40, 1.5)
        steer(tello, 0, 0, 0.5)
        assert tello.get_height() == 100
        tell(proxy.socket, "clear")
        time.sleep(0.5)

        # Each answer comes twice: from the second question on the client reads the answer to the one before.
        tell(proxy.socket, "drone tello1 answers duplicate 100%")
        assert 90 < int(tello.send_read_command("battery?")) <= 100
        time.sleep(0.2)
        assert 90 < int(tello.send_read_command("wifi?")) <= 100, "that was the battery again: wifi? says 90"
        time.sleep(0.2)
        assert tello.send_read_command("sdk?") == "90"
        tell(proxy.socket, "clear")
        tello.get_own_udp_object()["responses"].clear()
        assert tello.query_sdk_version() == "20"
        tello.land()

    sim.fly(client)
    one = proxy.end()["drones"][0]
    assert sim.end()["drones"][0]["landed"]
    x, y, *_ = sim.truth()[-1]
    assert math.dist((x, y), (0.8, 0)) < 0.35
    assert one["to"]["lost"] > 0 and one["to"]["reordered"] > 0 and one["to"]["duplicated"] > 0
    assert one["state"]["lost"] > 0
    assert one["answers"]["duplicated"] == 3 and one["answers"]["lost"] == 0
    for way in ("to", "answers", "state"):
        c = one[way]
        assert c["came"] + c["duplicated"] == c["went"] + c["lost"] + c["no_room"] + c["waiting"]


@pytest.mark.skipif(not LONG, reason="whole flights with lost answers take minutes: LEDGERLINE_LONG=1")
@pytest.mark.parametrize("effects", ["clear", "delay 200ms", "loss 5%", "duplicate 20% 20ms", "reorder 20% 150ms",
                                     "delay 200ms, loss 5%, reorder 5% 100ms"])
def test_a_whole_flight_of_moves_lands_under(sky, effects):
    sim, proxy = sky
    proxy.tell(f"drone tello1 both {effects}")

    def client():
        from djitellopy import Tello, TelloException
        tello = Tello(FRONT)
        shifted = refused = 0
        tello.connect()
        moves = [tello.takeoff, *[lambda: tello.move_forward(50), lambda: tello.rotate_clockwise(90)] * 4]
        for move in moves:
            try:
                move()
            except TelloException:
                refused += 1  # a doubled command, or one whose answer was lost and which was flown again
            time.sleep(0.3)
            left = tello.get_own_udp_object()["responses"]
            shifted += len(left)
            left.clear()
        steer(tello, 0, 0, 0.5)
        tell(proxy.socket, "clear")
        time.sleep(0.5)
        tello.land()
        print(f"{effects}: {refused} of {len(moves)} moves refused, {shifted} answers nobody asked for")

    sim.fly(client, timeout_s=300)
    one = proxy.end()["drones"][0]
    for what, counted in (("loss", "lost"), ("duplicate", "duplicated"), ("reorder", "reordered")):
        counts = {way: one[way][counted] for way in ("to", "answers", "state")}
        if what in effects:
            print(f"{effects}: {counted} {counts}")
        assert (sum(counts.values()) > 0) == (what in effects)
    assert sim.end()["drones"][0]["landed"]
