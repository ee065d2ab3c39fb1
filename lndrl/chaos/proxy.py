"""A TCP proxy that can be slow, deaf or gone: the network between an actor and the learner.

It runs in a thread of its own; every method may be called from any thread and returns at once.
"""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from contextlib import suppress

PIECE = 65536
WAITING = 64
"""Pieces on their way per direction, so that a stalled link makes its sender wait as TCP does."""


class Proxy:
    """Forwards ``tcp/127.0.0.1:port`` to ``target`` (host, port) until closed.

    ``delay`` (s) holds every byte back, ``stall`` forwards nothing while all connections stay
    open (half-open), ``cut`` ends them, and refuses new ones until ``mend``.
    """

    def __init__(self, target: tuple[str, int], port: int = 0) -> None:
        self.connections = 0  # accepted so far
        self.forwarded = 0  # bytes so far, both directions
        self._target = target
        self._delay = 0.0
        self._refusing = False
        self._writers: set[asyncio.StreamWriter] = set()
        self._loop = asyncio.new_event_loop()
        self._flowing = asyncio.Event()
        self._flowing.set()
        self._ended = asyncio.Event()
        self._ready = threading.Event()
        self._failure: OSError | None = None
        self.port = port
        self._thread = threading.Thread(target=self._run, name="proxy", daemon=True)
        self._thread.start()
        self._ready.wait(10.0)
        if self._failure is not None:
            raise self._failure

    @property
    def endpoint(self) -> str:
        """Where to connect."""
        return f"tcp/127.0.0.1:{self.port}"

    def delay(self, seconds: float) -> None:
        """Deliver everything ``seconds`` late, in order."""
        self._call(lambda: setattr(self, "_delay", seconds))

    def stall(self) -> None:
        """Deliver nothing, end nothing."""
        self._call(self._flowing.clear)

    def cut(self) -> None:
        """End all connections and those to come, as a router does that starts anew."""
        self._call(lambda: self._cut(True))

    def mend(self) -> None:
        """Be a good network again."""

        def heal() -> None:
            self._delay, self._refusing = 0.0, False
            self._flowing.set()

        self._call(heal)

    def close(self) -> None:
        """End everything; can be called twice."""
        self._call(self._ended.set)
        self._thread.join(5.0)

    def _call(self, work: Callable[[], None]) -> None:
        with suppress(RuntimeError):  # the loop is closed: nothing is left to change
            self._loop.call_soon_threadsafe(work)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._serve())
        except OSError as error:
            self._failure = error
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        server = await asyncio.start_server(self._connect, "127.0.0.1", self.port)
        self.port = server.sockets[0].getsockname()[1]
        self._ready.set()
        await self._ended.wait()
        server.close()
        self._cut(False)
        tasks = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _cut(self, refusing: bool) -> None:
        self._refusing = refusing
        for writer in list(self._writers):
            writer.transport.abort()

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.connections += 1
        if self._refusing:
            writer.transport.abort()
            return
        try:
            far_reader, far_writer = await asyncio.open_connection(*self._target)
        except OSError:
            writer.transport.abort()  # the learner is not there: as if nobody listened
            return
        ends = {writer, far_writer}
        self._writers |= ends
        try:
            ways = [self._carry(reader, far_writer), self._carry(far_reader, writer)]
            tasks = [asyncio.ensure_future(way) for way in ways]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
        finally:
            self._writers -= ends
            for end in ends:
                end.transport.abort()

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """One direction, until either end closes: pieces wait for their time, then for the flow."""
        pieces: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue(WAITING)

        async def take() -> None:
            while data := await reader.read(PIECE):
                await pieces.put((self._loop.time() + self._delay, data))
            await pieces.put((0.0, b""))

        taking = asyncio.ensure_future(take())
        try:
            while True:
                due, data = await pieces.get()
                if not data:
                    return
                await asyncio.sleep(max(0.0, due - self._loop.time()))
                await self._flowing.wait()
                # Counted first: whoever has received a byte finds it in the count.
                self.forwarded += len(data)
                writer.write(data)
                await writer.drain()
        except OSError:
            return
        finally:
            taking.cancel()
            # A reset connection ends the reading side with an error that nobody else asks for.
            with suppress(OSError, asyncio.CancelledError):
                await taking
