"""A wire between two hosts that is long, loses packets, or is cut: delay and loss for real TCP.

    python -m lndrl.chaos.wire --end HOST,INTERFACE --end HOST,INTERFACE --delay 0.05 --loss 0.001

Hosts are network namespaces (``lndrl.chaos.hosts``). Each end is a TUN interface whose packets this
process carries to the other end, late by ``delay`` s, some never. The kernels' TCP sees what it
would see on such a link. Linux has netem for that, but not every kernel is built with it. Commands
come as lines on standard input: ``delay S``, ``loss P``, ``cut``, ``heal``; it ends with its input.
"""

from __future__ import annotations

import argparse
import ctypes
import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

NAMESPACES = Path("/run/netns")
_TUN = Path("/dev/net/tun")
_CLONE_NEWNET = 0x40000000
_TUNSETIFF = 0x400454CA
_IFF_TUN, _IFF_NO_PI = 0x0001, 0x1000
_LARGEST = 65536  # bytes of a packet
_AT_ONCE = 64  # packets read from one end before the other has its turn
_QUEUE = 16 * 2**20  # bytes on their way per direction; what does not fit is lost, as in a router


class Wire:
    """Carries packets between two TUN descriptors; ``clock``: monotonic s."""

    def __init__(self, ends: tuple[int, int], delay: float, loss: float, seed: int = 0) -> None:
        self.delay, self.loss, self.is_cut = delay, loss, False
        self.carried, self.lost = [0, 0], [0, 0]  # bytes, packets; by the end they came from
        self._ends = ends
        self._draw = random.Random(seed)
        self._queues: tuple[deque[tuple[float, bytes]], ...] = (deque(), deque())
        self._waiting = [0, 0]  # bytes

    def obey(self, line: str) -> str:
        """Do what a command says; returns what there is to say to it."""
        word, _, value = line.partition(" ")
        if word in ("delay", "loss"):
            setattr(self, word, float(value))
        elif word in ("cut", "heal"):
            self.is_cut = word == "cut"
        elif word != "count":
            raise ValueError(f"{line!r} is no command of a wire")
        return f"{self.carried[0]} {self.carried[1]} {self.lost[0]} {self.lost[1]}"

    def wait(self) -> float | None:
        """s until the next packet must leave; None while there is none."""
        heads = [queue[0][0] for queue in self._queues if queue]
        return max(0.0, min(heads) - time.monotonic()) if heads else None

    def take(self, side: int) -> None:
        """Read what has come at one end."""
        due = time.monotonic() + self.delay
        for _ in range(_AT_ONCE):
            try:
                packet = os.read(self._ends[side], _LARGEST)
            except BlockingIOError:
                return
            full = self._waiting[side] + len(packet) > _QUEUE
            if self.is_cut or full or (self.loss and self._draw.random() < self.loss):
                self.lost[side] += 1
                continue
            self._queues[side].append((due, packet))
            self._waiting[side] += len(packet)

    def give(self) -> None:
        """Hand over what is due at the other end."""
        now = time.monotonic()
        for side, queue in enumerate(self._queues):
            while queue and queue[0][0] <= now:
                packet = queue.popleft()[1]
                self._waiting[side] -= len(packet)
                self.carried[side] += len(packet)
                with suppress(OSError):  # that end's interface is down, or its queue is full
                    os.write(self._ends[1 - side], packet)


def enter(host: str) -> None:
    """Go to a namespace, with this thread and those that it starts; raises OSError."""
    libc = ctypes.CDLL(None, use_errno=True)
    with (NAMESPACES / host).open("rb") as namespace:
        if libc.setns(namespace.fileno(), _CLONE_NEWNET) != 0:
            number = ctypes.get_errno()
            raise OSError(number, os.strerror(number))


def tun(host: str, interface: str) -> int:
    """A TUN interface in a namespace, as a descriptor; raises OSError where not permitted."""
    enter(host)
    descriptor = os.open(_TUN, os.O_RDWR | os.O_NONBLOCK)
    request = struct.pack("16sH", interface.encode(), _IFF_TUN | _IFF_NO_PI)
    fcntl.ioctl(descriptor, _TUNSETIFF, request.ljust(40, b"\0"))
    return descriptor


def carry(wire: Wire, ends: tuple[int, int], commands: int) -> None:
    """Carry, and obey what comes as lines on the descriptor ``commands``, until that ends."""
    poll = select.poll()
    for descriptor in (*ends, commands):
        poll.register(descriptor, select.POLLIN)
    rest = b""
    while True:
        left = wire.wait()
        for descriptor, _ in poll.poll(None if left is None else 1e3 * left):
            if descriptor != commands:
                wire.take(ends.index(descriptor))
                continue
            data = os.read(commands, 4096)
            if not data:
                return
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                print(wire.obey(line.decode()), flush=True)
        wire.give()


def main(arguments: Sequence[str] | None = None) -> int:
    """A wire from the command line."""
    parser = argparse.ArgumentParser(prog="python -m lndrl.chaos.wire", description=__doc__)
    parser.add_argument("--end", action="append", required=True, metavar="HOST,INTERFACE")
    parser.add_argument("--delay", type=float, default=0.0, help="s each way")
    parser.add_argument("--loss", type=float, default=0.0, help="share of packets, each way")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    try:
        one, other = (tun(*end.split(",")) for end in options.end)
    except (OSError, ValueError, TypeError) as error:
        print(f"no wire between {' and '.join(options.end)} ({error})", file=sys.stderr)
        return 2
    print("ready", flush=True)
    carry(Wire((one, other), options.delay, options.loss, options.seed), (one, other), 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
