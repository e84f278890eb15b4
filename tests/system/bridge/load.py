"""Writes and reads in processes of their own, for figures: load.py write|read DOMAIN ... (see main)."""
import json
import sys
import time

from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclone import Number, Text, Writer, qos


def write(domain: int, topics: int, rate: float, seconds: float, size: int) -> None:
    """`rate` messages a second in all, each beginning with its number within its topic."""
    writers = [Writer(domain, f"/load/t{k}", Text).wait_for_readers() for k in range(topics)]
    begin, padding = time.monotonic(), "x" * size
    for number in range(int(rate * seconds)):
        writers[number % topics].write(Text(f"{number // topics} {padding}"))
        if number % 10 == 9:
            time.sleep(max(0, begin + (number + 1) / rate - time.monotonic()))
    time.sleep(1)  # what is not acknowledged yet is sent again, while the writer lives
    print(json.dumps({"written": int(rate * seconds), "seconds": time.monotonic() - begin - 1}))


def images(domain: int, rate: float, seconds: float, size: int) -> None:
    writer = Writer(domain, "/load/image", Text, reliable=True).wait_for_readers()
    begin, image = time.monotonic(), Text("x" * size)
    for number in range(int(rate * seconds)):
        writer.write(image)
        time.sleep(max(0, begin + (number + 1) / rate - time.monotonic()))
    time.sleep(1)


def joystick(here: int, there: int, seconds: float) -> None:
    """50 Hz of the time at which each was written, read in the other domain."""
    ages, order = [], []

    class Heard(Listener):
        def on_data_available(self, reader):
            now = time.monotonic_ns()
            for sample in reader.take(N=100):
                ages.append((now - sample.data) / 1e6)
                order.append(sample.data)
    writer = Writer(here, "/load/joy", Number).wait_for_readers()
    participant = DomainParticipant(there)
    reader = DataReader(participant, Topic(participant, "rt/load/joy", Number), qos=qos(), listener=Heard())
    deadline = time.monotonic() + 60
    while not ages and time.monotonic() < deadline:  # until the way is open
        writer.write(Number(time.monotonic_ns()))
        time.sleep(0.1)
    time.sleep(0.5)
    ages.clear()
    begin, count = time.monotonic(), int(50 * seconds)
    for number in range(count):
        writer.write(Number(time.monotonic_ns()))
        time.sleep(max(0, begin + (number + 1) / 50 - time.monotonic()))
    time.sleep(1)
    assert order == sorted(set(order))
    ages.sort()
    del reader
    print(json.dumps({"written": count, "came": len(ages), "median_ms": ages[len(ages) // 2],
                      "p99_ms": ages[int(len(ages) * 0.99)], "max_ms": ages[-1]}))


if __name__ == "__main__":
    kind, *numbers = sys.argv[1:]
    numbers = [float(n) for n in numbers]
    if kind == "write":
        write(int(numbers[0]), int(numbers[1]), numbers[2], numbers[3], int(numbers[4]))
    elif kind == "images":
        images(int(numbers[0]), numbers[1], numbers[2], int(numbers[3]))
    else:
        joystick(int(numbers[0]), int(numbers[1]), numbers[2])
