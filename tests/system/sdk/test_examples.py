"""What the examples that djitellopy is published with (its repository's folder examples/) ask of a drone: the same calls in the
same order and with the same numbers, in words of our own, since no package on PyPI carries those files. The drones sense as a
Tello does, and nothing else tells them where they are.

No video is simulated: `streamon` is answered and no picture comes. Of examples with pictures all other calls are made;
get_frame_read() fails as it does beside a Tello whose video does not arrive, and that ends such an example as it is written.
display-video.py does not fly, and calls what djitellopy 2.5.0 does not have.

All of them fly at once, each from a host of its own, on drones far from each other.
"""
import logging
import math
import os
import time

import pytest
from conftest import Drones

SPACING_M = 20
PANORAMA_UP_CM = 500 if os.environ.get("LEDGERLINE_LONG") == "1" else 100  # the example's own number takes ten seconds more
# Below the drone that looks for pads, and a step behind. No 4, of which the example climbs: from a hover at 1 m to where no pad is seen.
PADS = "3:0:0,1:-0.4:0"


class Example:
    """One example's flight: what it does with which of the drones."""

    def __init__(self, calls, drones: int = 1):
        self.calls, self.drones, self.first = calls, drones, 0

    def fly(self, hosts: list) -> None:
        from djitellopy import Tello
        Tello.LOGGER.setLevel(logging.WARNING)  # else each rc is a line
        self.calls(*hosts[self.first:self.first + self.drones])


def connected(host: str):
    from djitellopy import Tello
    tello = Tello(host)
    tello.connect()
    return tello


def no_picture(tello) -> None:
    """get_frame_read(), of which djitellopy has a timeout of its own; shorter here, since nothing will come."""
    from djitellopy import Tello, TelloException
    Tello.FRAME_GRAB_TIMEOUT = 0.5
    with pytest.raises(TelloException, match="Failed to grab video frames"):
        tello.get_frame_read()


def simple(host: str) -> None:
    tello = connected(host)
    tello.takeoff()
    tello.move_left(100)
    tello.rotate_clockwise(90)
    tello.move_forward(100)
    tello.land()


def mission_pads(host: str) -> None:
    tello = connected(host)
    tello.enable_mission_pads()
    tello.set_mission_pad_detection_direction(1)
    tello.takeoff()
    # Ahead there is none: these pads lie on the floor. From here on as the example goes on, but for a look down.
    time.sleep(0.3)
    assert tello.get_mission_pad_id() == -1
    tello.set_mission_pad_detection_direction(0)
    time.sleep(0.3)
    seen, deadline = [], time.monotonic() + 60
    while (pad := tello.get_mission_pad_id()) != 1:
        assert time.monotonic() < deadline, seen
        if pad == 3:
            tello.move_back(30)
            tello.rotate_clockwise(90)
        if pad > 0:
            seen.append(pad)
    assert seen == [3], seen
    tello.disable_mission_pads()
    tello.land()
    tello.end()


def simple_swarm(*hosts: str) -> None:
    from djitellopy import TelloException, TelloSwarm

    def unless_nothing(centimetres: int, move) -> None:
        """The SDK moves by 20 to 500 cm: the first drone's 0 is refused, by a Tello as well, and ends the example there."""
        if centimetres > 0:
            return move(centimetres)
        with pytest.raises(TelloException, match="out of range"):
            move(centimetres)

    swarm = TelloSwarm.fromIps(list(hosts))
    swarm.connect()
    swarm.takeoff()
    swarm.move_up(100)
    swarm.sequential(lambda i, tello: unless_nothing(i * 20, tello.move_forward))
    swarm.parallel(lambda i, tello: unless_nothing(i * 100, tello.move_left))
    swarm.land()
    swarm.end()


def take_picture(host: str) -> None:
    tello = connected(host)
    tello.streamon()
    no_picture(tello)
    tello.takeoff()
    tello.land()


def record_video(host: str) -> None:
    tello = connected(host)
    tello.streamon()
    no_picture(tello)
    tello.takeoff()
    tello.move_up(100)
    tello.rotate_counter_clockwise(360)
    tello.land()


def panorama(host: str) -> None:
    """Its half turn clockwise."""
    tello = connected(host)
    assert tello.get_battery() > 95
    tello.takeoff()
    tello.move_up(PANORAMA_UP_CM)
    tello.streamoff()
    tello.streamon()
    tello.rotate_counter_clockwise(90)
    for _ in range(3):
        no_picture(tello)
        time.sleep(1)
        tello.rotate_clockwise(60)
    no_picture(tello)
    time.sleep(1)
    tello.rotate_counter_clockwise(90)
    tello.streamoff()
    tello.land()


def manual_control_opencv(host: str) -> None:
    """Each of its keys once. Its s sinks, as its f does."""
    tello = connected(host)
    tello.streamon()
    no_picture(tello)
    tello.takeoff()
    for move in (tello.move_forward, tello.move_down, tello.move_left, tello.move_right, tello.rotate_clockwise,
                 tello.rotate_counter_clockwise, tello.move_up, tello.move_down):
        move(30)
    tello.land()


def manual_control_pygame(host: str) -> None:
    """T, then up, right, w and d held for a second each, L, escape: rc 120 times a second, also where no key is held."""
    tello = connected(host)
    tello.set_speed(10)
    tello.streamoff()
    tello.streamon()
    no_picture(tello)
    tello.takeoff()
    for left_right, forward, up, yaw in ((0, 60, 0, 0), (60, 0, 0, 0), (0, 0, 60, 0), (0, 0, 0, 60), (0, 0, 0, 0)):
        until = time.monotonic() + 1
        while time.monotonic() < until:
            tello.send_rc_control(left_right, forward, up, yaw)
            assert tello.get_battery() > 90
            time.sleep(1 / 120)
    tello.land()
    tello.end()


def manual_control_pygame_v2(host: str) -> None:
    """t, then right and w held for a second each, l, escape: sticks at their ends while a key is held, one zero behind it."""
    tello = connected(host)
    time.sleep(1)
    tello.streamon()
    time.sleep(1)
    no_picture(tello)
    tello.get_barometer()
    ground_cm = tello.get_barometer()
    tello.takeoff()
    for rc in ((100, 0, 0, 0), (0, 0, 100, 0)):
        until = time.monotonic() + 1
        while time.monotonic() < until:
            tello.send_rc_control(*rc)
            assert tello.get_battery() > 90 and tello.get_flight_time() >= 0
            assert abs(tello.get_roll()) < 45 and abs(tello.get_pitch()) < 45 and abs(tello.get_yaw()) < 10
            assert -1500 < tello.get_acceleration_z() < 0
            assert abs(tello.get_acceleration_x()) < 1000 and abs(tello.get_acceleration_y()) < 1000
            time.sleep(0.01)
    tello.send_rc_control(0, 0, 0, 0)
    time.sleep(1)
    assert 100 < tello.get_barometer() - ground_cm < 300
    tello.land()


EXAMPLES = {"mission-pads": Example(mission_pads), "simple": Example(simple), "simple-swarm": Example(simple_swarm, 3),
            "take-picture": Example(take_picture), "record-video": Example(record_video), "panorama": Example(panorama),
            "manual-control-opencv": Example(manual_control_opencv), "manual-control-pygame": Example(manual_control_pygame),
            "manual-control-pygame-v2": Example(manual_control_pygame_v2)}


class Flown:
    """Where each example's drones really were, from their start."""

    def __init__(self, sim: Drones):
        summary = sim.end()["drones"]
        self.paths = {}
        for name, example in EXAMPLES.items():
            numbers = range(example.first + 1, example.first + 1 + example.drones)
            assert all(summary[k - 1]["flew"] and summary[k - 1]["landed"] for k in numbers), name
            self.paths[name] = [self.from_start(sim.truth(k)) for k in numbers]

    @staticmethod
    def from_start(truth: list) -> list:
        x0, y0, *_ = truth[0]
        return [(x - x0, y - y0, z, yaw) for x, y, z, yaw, _ in truth]

    def path(self, name: str) -> list:
        (path,) = self.paths[name]
        return path


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    count = 0
    for example in EXAMPLES.values():
        example.first, count = count, count + example.drones
    sim = Drones(tmp_path_factory.mktemp("examples"), count, len(EXAMPLES), "--pads", PADS, "--wind", "0",
                 "--mocap-hz", "0", "--spacing", str(SPACING_M))
    try:
        begin = time.monotonic()
        sim.fly(*(lambda e=e: e.fly(sim.hosts) for e in EXAMPLES.values()))
        print(f"{len(EXAMPLES)} examples on {count} drones: {time.monotonic() - begin:.0f} s")
        yield Flown(sim)
    finally:
        sim.close()


def turned(path: list) -> float:
    """All of the turning, counter-clockwise, more than once around as well."""
    return sum(math.remainder(b[3] - a[3], 2 * math.pi) for a, b in zip(path, path[1:]))


def top(path: list) -> float:
    return max(z for _, _, z, _ in path)


def test_simple(flown):
    path = flown.path("simple")
    assert max(y for _, y, *_ in path) == pytest.approx(1.0, abs=0.2)
    assert turned(path) == pytest.approx(-math.pi / 2, abs=0.1)
    assert math.dist(path[-1][:2], (0, 0)) < 0.3, "a metre to the left, and back along its new nose"


def test_mission_pads(flown):
    path = flown.path("mission-pads")
    assert math.dist(path[-1][:2], (-0.3, 0)) < 0.2
    assert turned(path) == pytest.approx(-math.pi / 2, abs=0.15)


def test_simple_swarm(flown):
    for i, path in enumerate(flown.paths["simple-swarm"]):
        assert math.dist(path[-1][:2], (0.2 * i, 1.0 * i)) < 0.3, i
        assert top(path) == pytest.approx(2.0, abs=0.15)


def test_those_with_pictures_fly_without(flown):
    assert top(flown.path("take-picture")) == pytest.approx(1.0, abs=0.15)
    path = flown.path("record-video")
    assert top(path) == pytest.approx(2.0, abs=0.15) and turned(path) == pytest.approx(2 * math.pi, abs=0.15)
    path = flown.path("panorama")
    yaws = [math.degrees(yaw) for *_, yaw in path]
    assert top(path) == pytest.approx(1 + PANORAMA_UP_CM / 100, abs=0.3)
    assert (max(yaws), min(yaws), yaws[-1]) == pytest.approx((90, -90, 0), abs=6)


def test_manual_control(flown):
    path = flown.path("manual-control-opencv")
    assert math.dist(path[-1][:2], (0.3, 0)) < 0.2 and abs(turned(path)) < 0.1 and top(path) < 1.2
    path = flown.path("manual-control-pygame")
    x, y, *_ = path[-1]
    assert x == pytest.approx(0.6, abs=0.2) and y == pytest.approx(-0.6, abs=0.2), "sticks are m/s, whatever set_speed said"
    assert top(path) == pytest.approx(1.6, abs=0.2) and turned(path) == pytest.approx(-math.radians(60), abs=0.3)
    path = flown.path("manual-control-pygame-v2")
    x, y, *_ = path[-1]
    assert abs(x) < 0.2 and y == pytest.approx(-1.0, abs=0.3) and top(path) == pytest.approx(2.0, abs=0.3)
