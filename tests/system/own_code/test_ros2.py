"""A controller over the drone's ROS 2 topics under test."""
from flights import assert_nothing_left
from own_code import EXAMPLES, broken, fly, planted


def test_a_controller_that_leaves_the_gap_out_passes(tmp_path):
    code, flown = fly(tmp_path, "ros2-gap", EXAMPLES / "ros2_square.py", "--shim")
    assert code == 0, broken(flown)
    assert_nothing_left()


def test_one_that_integrates_across_the_gap_is_caught(tmp_path):
    program = planted(tmp_path, "ros2_square.py", "        dt_s = min(dt_s, MAX_STEP_S)\n", "")
    (tmp_path / "ros2_messages.py").symlink_to(EXAMPLES / "ros2_messages.py")
    code, flown = fly(tmp_path, "ros2-gap", program, "--shim")
    assert code == 1
    assert "path within 0.3 m" in broken(flown)
    assert_nothing_left()
