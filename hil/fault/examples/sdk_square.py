"""A djitellopy script that flies a square of 1 m; nothing in it knows of Ledgerline.

    ledgerline fault run hil/scenarios/own/sdk-client-errors.toml --real --out runs --program 'python3 sdk_square.py'

A usual mistake: to ignore an `error`. Let until_flown() return where it asks again, and the scenario catches it.
It needs `pip install djitellopy`; build/venv, which ./run-tests makes, has it.
"""
import time

from djitellopy import Tello, TelloException

TIMEOUT_S = 20


def until_flown(move, centimetres: int) -> None:
    """A Tello that answers `error` has flown nothing, and djitellopy asks three times within a second: whatever was in the
    way may last longer, so it is asked again. Given up, the drone is where nobody meant it to be."""
    begin = time.monotonic()
    while True:
        try:
            move(centimetres)
            return
        except TelloException as error:
            if time.monotonic() > begin + TIMEOUT_S:
                raise
            print(error, flush=True)
            time.sleep(0.5)


tello = Tello()
tello.connect()
tello.takeoff()
try:
    for move in (tello.move_forward, tello.move_left, tello.move_back, tello.move_right):
        until_flown(move, 100)
finally:
    tello.land()
