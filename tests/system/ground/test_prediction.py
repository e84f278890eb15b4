"""Prediction with the real processes: a slow ledger, and the same controller with none."""
import os
import signal

import pytest
from flights import assert_nothing_left, fly, no_flight_outlives_its_test, printed, result, wait_for_flight  # noqa: F401


def test_through_blocks_of_400_ms_it_holds_its_path_at_speed(tmp_path):
    flight = fly(tmp_path, "--speed", "1", "--laps", "1", "--batch-timeout", "400ms", "--batch-count", "100")
    assert flight.wait(90) == 0, printed(tmp_path)
    drone = result(tmp_path)["drones"][0]
    print(f"  two-way {drone['two_way_ms']['median']:.0f} ms, age {drone['age_ms']['median']:.0f} ms, "
          f"rms {drone['cross_track_m']['rms']} m, max {drone['cross_track_m']['max']} m")
    assert drone["two_way_ms"]["median"] > 300
    assert drone["cross_track_m"]["max"] < 0.4
    assert drone["commands"]["refused"] == 0, drone["commands"]
    assert drone["slowed_to_mps"] is not None and drone["slowed_to_mps"] < 1
    assert_nothing_left()


def test_without_a_ledger_waypoints_are_flown_by_the_controller_beside_the_driver(tmp_path):
    way = tmp_path / "way.csv"
    way.write_text("x,y,z,speed\n0,0,1\n1.5,0,1.2,0.5\n1.5,1\n0,1\n")
    flight = fly(tmp_path, "--ledger", "none", "--shape", str(way), "--ramp", "0.6:0.2", "--laps", "1")
    assert flight.wait(60) == 0, printed(tmp_path)
    report = result(tmp_path)
    drone = report["drones"][0]
    assert report["asked"]["ledger"] == "none" and report["asked"]["shape"] == "waypoints"
    assert drone["two_way_ms"]["median"] < 10
    assert drone["commands"]["applied"] == drone["commands"]["sent"] > 100
    assert drone["cross_track_m"]["max"] < 0.3
    assert [turn["asked_mps"] for turn in drone["turns"]] == [0.6]
    assert not (tmp_path / "run" / "ledger").exists()
    assert_nothing_left()


@pytest.mark.skipif(os.environ.get("LEDGERLINE_LONG") != "1", reason="one more flight in real time; LEDGERLINE_LONG=1")
def test_without_a_ledger_ctrl_c_lands_the_drone(tmp_path):
    flight = fly(tmp_path, "--ledger", "none")
    wait_for_flight(tmp_path, flight)
    flight.send_signal(signal.SIGINT)
    assert flight.wait(40) == 1
    assert "asked to land" in printed(tmp_path)
    assert_nothing_left()
