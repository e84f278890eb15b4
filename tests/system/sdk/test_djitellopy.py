"""djitellopy 2.5.0 as it comes from PyPI flies the simulated drones."""
import math
import time

import pytest


def test_one_drone_flies_moves_and_answers_queries(drones):
    sim = drones(1)

    def client():
        from djitellopy import Tello
        tello = Tello(sim.hosts[0])
        tello.connect()
        assert tello.get_battery() > 95
        assert tello.get_height() == 0
        tello.takeoff()
        assert tello.is_flying
        time.sleep(0.3)
        assert tello.get_height() == 100
        assert abs(tello.get_distance_tof() - 100) < 10
        tello.set_speed(100)
        tello.move_forward(100)
        tello.move_left(80)
        tello.move_up(40)
        tello.rotate_clockwise(90)
        tello.go_xyz_speed(50, 0, -30, 60)
        tello.curve_xyz_speed(50, 50, 0, 100, 0, 0, 50)
        tello.flip_forward()
        time.sleep(0.2)
        assert abs(tello.get_yaw() - 90) < 5
        assert tello.get_flight_time() > 10
        assert tello.get_mission_pad_id() == -2

        assert tello.query_battery() > 95
        assert tello.query_attitude().keys() == {"pitch", "roll", "yaw"}
        assert abs(tello.query_distance_tof() - 110) < 25
        assert tello.query_sdk_version() == "20"
        assert tello.query_serial_number()
        assert tello.query_wifi_signal_noise_ratio() == "90"
        assert tello.query_active()
        tello.enable_mission_pads()
        tello.set_mission_pad_detection_direction(2)
        tello.disable_mission_pads()
        tello.send_keepalive()
        tello.streamon()
        tello.streamoff()
        tello.send_expansion_command("led 255 0 0")
        tello.land()
        assert not tello.is_flying
        tello.turn_motor_on()
        tello.turn_motor_off()
        tello.reboot()

    sim.fly(client)
    summary = sim.end()
    assert summary["drones"][0]["landed"]
    x, y, z, yaw, flying = sim.truth()[-1]
    # forward 1 m, left 0.8 m; then facing south: 0.5 m and a curve to 1 m ahead
    assert math.dist((x, y), (1.0, 0.8 - 1.5)) < 0.4
    assert abs(yaw + math.pi / 2) < 0.1
    assert not flying and abs(z) < 0.05


def test_a_drone_finds_a_mission_pad_and_flies_above_it(drones):
    sim = drones(1, 1, "--pads", "3:0.3:0.2:90", "--wind", "0", "--mocap-hz", "0")

    def client():
        from djitellopy import Tello
        tello = Tello(sim.hosts[0])
        tello.connect()
        tello.enable_mission_pads()
        tello.takeoff()
        time.sleep(0.3)
        assert tello.get_mission_pad_id() == 3
        # Its rocket points north (y): the drone is 0.2 m behind it and 0.3 m to its left.
        assert abs(tello.get_mission_pad_distance_x() + 20) < 8
        assert abs(tello.get_mission_pad_distance_y() - 30) < 8
        assert abs(tello.get_mission_pad_distance_z() - 100) < 8
        tello.go_xyz_speed_mid(0, 0, 70, 30, 3)
        time.sleep(0.5)
        assert abs(tello.get_mission_pad_distance_x()) < 12
        tello.land()

    sim.fly(client)
    sim.end()
    x, y, z, yaw, flying = sim.truth()[-1]
    assert math.dist((x, y), (0.3, 0.2)) < 0.2


def test_rc_is_never_answered_and_moves_the_drone(drones):
    sim = drones(1)

    def client():
        from djitellopy import Tello
        tello = Tello(sim.hosts[0])
        tello.connect()
        tello.send_rc_control(0, 100, 0, 0)  # on the ground: nothing
        tello.takeoff()
        over = time.monotonic() + 2  # not so many times: a busy machine sleeps longer
        while time.monotonic() < over:
            tello.send_rc_control(0, 50, 0, 0)
            time.sleep(0.05)
        assert tello.get_speed_x() == 5  # dm/s
        over = time.monotonic() + 1
        while time.monotonic() < over:
            tello.send_rc_control(-30, 0, 20, 0)
            time.sleep(0.05)
        tello.send_rc_control(0, 0, 0, 0)
        time.sleep(1)
        assert tello.get_own_udp_object()["responses"] == []
        tello.land()

    sim.fly(client)
    sim.end()
    truth = sim.truth()
    before = [record for record in truth if not record[4]][0]
    assert math.hypot(before[0], before[1]) < 0.01
    x, y, *_ = truth[-1]
    assert x == pytest.approx(1.0, abs=0.25)
    assert y == pytest.approx(0.3, abs=0.15)


def test_bad_commands_raise_and_do_no_harm(drones):
    sim = drones(1)

    def client():
        from djitellopy import Tello, TelloException
        tello = Tello(sim.hosts[0], retry_count=1)
        with pytest.raises(TelloException, match="error Motor stop"):
            tello.connect()
            tello.move_forward(50)
        tello.takeoff()
        for text, why in (("forward 10", "out of range"), ("forward x", "error"), ("up 501", "out of range"),
                          ("go 5 5 5 50", "out of range"), ("cw 0", "out of range"), ("flip z", "error"),
                          ("jump 50 0 80 50 0 m1 m2", "error"), ("look up", "unknown command"), ("takeoff", "error")):
            with pytest.raises(TelloException, match=why):
                tello.send_control_command(text)
        with pytest.raises(TelloException, match="unknown command"):
            tello.send_read_command("colour?") and tello.send_control_command("colour?")
        tello.move_back(30)  # answers are not shifted
        assert tello.query_battery() > 90
        tello.land()

    sim.fly(client)
    assert sim.end()["drones"][0]["landed"]
    x, y, *_ = sim.truth()[-1]
    assert math.dist((x, y), (-0.3, 0)) < 0.15


def test_emergency_stops_the_motors(drones):
    sim = drones(1)

    def client():
        from djitellopy import Tello
        tello = Tello(sim.hosts[0])
        tello.connect()
        tello.takeoff()
        tello.emergency()
        time.sleep(1.5)
        assert tello.get_height() <= 10

    sim.fly(client)
    summary = sim.end()["drones"][0]
    assert summary["flew"]
    assert sim.truth()[-1][2] < 0.1


def test_a_swarm_of_three_flies_at_once(drones):
    sim = drones(3)

    def client():
        from djitellopy import TelloSwarm
        swarm = TelloSwarm.fromIps(sim.hosts)
        swarm.parallel(lambda i, tello: tello.connect())
        for tello in swarm:
            assert tello.get_battery() > 95
        swarm.parallel(lambda i, tello: tello.takeoff())

        def climb_then_wait(i, tello):
            tello.move_up(20 + 20 * i)
            swarm.sync(10.0)

        swarm.parallel(climb_then_wait)
        swarm.parallel(lambda i, tello: tello.rotate_clockwise(90 * i + 10))
        for i, tello in enumerate(swarm):
            tello.send_rc_control(0, 0, 0, 0)
            assert abs(tello.get_height() - (120 + 20 * i)) <= 10
        swarm.parallel(lambda i, tello: tello.land())

    sim.fly(client)
    assert [drone["landed"] for drone in sim.end()["drones"]] == [True] * 3
    for k in (1, 2, 3):
        assert max(record[2] for record in sim.truth(k)) == pytest.approx(1.0 + 0.2 * k, abs=0.1)
