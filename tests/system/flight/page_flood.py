"""Floods ground's page for so long; what it did is a line of JSON at the end. `streams`: 70 at once with the page's
token, from ten addresses, and a refused connection tries again. `connections`: 1,000 a second of an outsider 50 ms away:
every other one asks for something, or begins a handshake where the page has TLS, and the rest for nothing. `bodies`: 30
at once of 64 kB with the page's token, half of them slow."""
import argparse
import asyncio
import itertools
import json
import time

from station import client_hello

AWAY_S = 0.1  # a round trip of who is 50 ms away: what TLS needs between a connection and its first request
BODY_BYTES = 65_536
did = {"sent": 0, "answered": 0, "refused": 0}  # the rest was closed unanswered, or open when the flood ended


def costly_bodies() -> list[bytes]:
    """Of that length: many elements in one list, many keys in one object, and the maximum path that is accepted."""
    keys = ",".join(f'"{k:04}":0' for k in range(7_000))
    ones = "1" * 28
    waypoint = f'{{"x":0.{ones},"y":0.{ones},"z":1.{ones},"speed":0.5000000000}}'
    texts = ["{" + keys[:keys.rindex(",", 0, BODY_BYTES - 1)] + "}"]
    for element, count in (("{}", 21_000), ('{"x":1}', 8_000), (waypoint, 500)):
        texts.append('{"waypoints":[' + ",".join([element] * count) + "]}")
    return [text.ljust(BODY_BYTES).encode() for text in texts]


class Page:
    def __init__(self, url: str, token: str, end: float) -> None:
        self.place = url.split("://")[1]
        self.host, self.port = self.place.split(":")
        self.hello = client_hello(self.host) if url.startswith("https") else b""
        self.token, self.end = token, end

    def head(self, request: str, *lines: str) -> bytes:
        return "\r\n".join((f"{request} HTTP/1.1", f"Host: {self.place}", *lines, "", "")).encode()

    async def talk(self, say, wanted: bytes, address: str = "127.0.0.1") -> None:
        """One connection: `say` writes, and it reads until the other side closes, or the flood's end."""
        async def hear(reader) -> None:
            first = more = await reader.read(65_536)
            did["answered" if first.startswith(wanted) else "refused"] += bool(first)
            while more:
                more = await reader.read(65_536)

        did["sent"] += 1
        try:
            reader, writer = await asyncio.open_connection(self.host, int(self.port), local_addr=(address, 0))
            try:
                await say(writer)
                await asyncio.wait_for(hear(reader), self.end - time.monotonic())
            finally:
                writer.transport.abort()
        except (OSError, asyncio.TimeoutError):
            pass

    async def streams(self) -> None:
        request = self.head("GET /api/v1/stream", "Upgrade: websocket", "Connection: Upgrade",
                            "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
                            f"Sec-WebSocket-Protocol: ledgerline.v1, token.{self.token}")

        async def open_stream(writer) -> None:
            writer.write(request)

        async def keep_trying(address: str) -> None:
            while time.monotonic() < self.end:
                await self.talk(open_stream, b"HTTP/1.1 101", address)
                await asyncio.sleep(0.5)

        await asyncio.gather(*(keep_trying(f"127.0.0.{1 + k % 10}") for k in range(70)))

    async def connections(self) -> None:
        async def ask(writer) -> None:
            await asyncio.sleep(AWAY_S)
            writer.write(self.hello or self.head("GET /api/v1/drones"))

        async def say_nothing(writer) -> None:
            pass

        at, open_ones = time.monotonic(), set()
        for say in itertools.cycle((ask, say_nothing)):
            if at >= self.end:
                break
            one = asyncio.create_task(self.talk(say, b"\x16\x03" if self.hello else b"HTTP/1.1 401"))
            open_ones.add(one)
            one.add_done_callback(open_ones.discard)
            at += 0.001
            await asyncio.sleep(max(0, at - time.monotonic()))
        await asyncio.gather(*open_ones)

    async def bodies(self) -> None:
        def post(body: bytes, pieces: int):
            async def write(writer) -> None:
                writer.write(self.head("POST /api/v1/drones/tello1/path", f"Authorization: Bearer {self.token}",
                                       "Connection: close", f"Content-Length: {len(body)}"))
                for k in range(pieces):
                    writer.write(body[k * len(body) // pieces:(k + 1) * len(body) // pieces])
                    await asyncio.sleep(0.05 if pieces > 1 else 0)
            return write

        async def keep_posting(body: bytes, pieces: int) -> None:
            while time.monotonic() < self.end:
                await self.talk(post(body, pieces), b"HTTP/1.1 40")
                await asyncio.sleep(0.1)

        costly = itertools.cycle(costly_bodies())
        await asyncio.gather(*(keep_posting(next(costly), 20 if k % 8 < 4 else 1) for k in range(30)))


def main() -> None:
    line = argparse.ArgumentParser()
    line.add_argument("what", choices=["streams", "connections", "bodies"])
    line.add_argument("--url", required=True)
    line.add_argument("--token", required=True)
    line.add_argument("--seconds", type=float, required=True)
    words = line.parse_args()
    print('{"begins": true}', flush=True)
    asyncio.run(getattr(Page(words.url, words.token, time.monotonic() + words.seconds), words.what)())
    print(json.dumps(did))


if __name__ == "__main__":
    main()
