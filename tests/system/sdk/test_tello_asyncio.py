"""tello-asyncio 2.1.3 as it comes from PyPI flies the simulated drones."""
import asyncio
import math

import pytest


def test_one_drone_flies_moves_and_answers_queries(drones):
    sim = drones(1)

    async def flight():
        from tello_asyncio import Tello, Vector
        states = []
        drone = Tello(sim.hosts[0], on_state=lambda _, state: states.append(state))
        await drone.connect()
        await asyncio.sleep(0.3)
        assert drone.state.battery > 95
        await drone.takeoff()
        await drone.move_up(30)
        await drone.move_forward(100)
        await drone.move_right(50)
        await drone.turn_counterclockwise(90)
        await drone.go_to(relative_position=Vector(50, 0, -20), speed=60)
        await drone.curve_to(via_relative_position=Vector(50, 50, 0), relative_position=Vector(100, 0, 0), speed=50)
        for _ in range(20):
            await drone.remote_control(left_right=0, forward_back=-30, up_down=0, yaw=0)
            await asyncio.sleep(0.05)
        await drone.stop()
        await drone.set_speed(50)
        assert await drone.speed == 50
        assert await drone.query_battery() > 95
        assert int(await drone.sdk_version) == 20
        assert (await drone.serial_number).strip()
        assert await drone.wifi_signal_to_noise_ratio == 90
        await drone.enable_mission_pads()
        assert len(states) > 100
        assert states[-1].height == pytest.approx(110, abs=10)
        assert states[-1].yaw == pytest.approx(-90, abs=5)
        await drone.land()
        await drone.disconnect()

    sim.fly(lambda: asyncio.run(flight()))
    assert sim.end()["drones"][0]["landed"]
    x, y, *_ = sim.truth()[-1]
    # forward 1 m, right 0.5 m; then facing north: 0.5 m, a curve to 1 m ahead, back for a second at 0.3 m/s
    assert math.dist((x, y), (1.0, -0.5 + 1.5 - 0.3)) < 0.3


def test_a_refusal_reaches_the_caller_and_the_client_lands(drones):
    sim = drones(1)

    async def flight():
        from tello_asyncio import Tello
        errors = []
        drone = Tello(sim.hosts[0], on_error=lambda _, error: errors.append(str(error)))
        await drone.connect()
        await drone.move_forward(100)
        assert "error Motor stop" in errors.pop()
        await drone.takeoff()
        await drone.move_forward(5)
        assert "out of range" in errors.pop()
        await drone.send("colour")
        assert "unknown command: colour" in errors.pop()
        await drone.move_back(20)
        assert errors == []
        await drone.land()
        await drone.disconnect()

    async def strict_flight():
        """Without on_error this client lands and closes at the first refusal."""
        from tello_asyncio import Tello
        drone = Tello(sim.hosts[0])
        await drone.connect()
        await drone.takeoff()
        with pytest.raises(Tello.Error, match="out of range"):
            await drone.move_up(10)

    sim.fly(lambda: asyncio.run(flight()))
    sim.fly(lambda: asyncio.run(strict_flight()))
    assert sim.end()["drones"][0]["landed"]


def test_emergency_is_answered(drones):
    sim = drones(1)

    async def flight():
        from tello_asyncio import Tello
        drone = Tello(sim.hosts[0])
        await drone.connect()
        await drone.takeoff()
        await drone.emergency_stop()
        await asyncio.sleep(1.5)
        await drone.disconnect()

    sim.fly(lambda: asyncio.run(flight()))
    sim.end()
    assert sim.truth()[-1][2] < 0.1


def test_three_drones_fly_at_once(drones):
    """A host each: this client's sockets hold 0.0.0.0:8889 and :8890."""
    sim = drones(3, 3)

    def client_of(host: str, up_cm: int):
        async def flight():
            from tello_asyncio import Tello
            drone = Tello(host)
            await drone.connect()
            await drone.takeoff()
            await drone.move_up(up_cm)
            await drone.turn_clockwise(90)
            await drone.land()
            await drone.disconnect()
        return lambda: asyncio.run(flight())

    sim.fly(*(client_of(host, 20 * k) for k, host in enumerate(sim.hosts, 1)))
    assert [drone["landed"] for drone in sim.end()["drones"]] == [True] * 3
    for k in (1, 2, 3):
        assert max(record[2] for record in sim.truth(k)) == pytest.approx(1.0 + 0.2 * k, abs=0.1)
