"""Several hosts on one machine: network namespaces, wires between them, and a site behind NAT.

    with Hosts() as hosts:
        hosts.add("learner")
        ...

needs root (or CAP_NET_ADMIN and CAP_SYS_ADMIN) and iproute2; ``missing`` says what is not there.
Nothing in a namespace reaches anything outside: there is no link that leads there.
"""

from __future__ import annotations

import ipaddress
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lndrl.errors import UserError

_WAIT = 20.0  # s for a wire to be there, or to answer
_MTU = 1500


def missing(nat: bool = False) -> str:
    """Why there can be no hosts here, in a sentence; empty where there can. ``nat``: with NAT."""
    if shutil.which("ip") is None:
        return "network namespaces need iproute2 (the command ip), which is not installed"
    if nat and shutil.which("nft") is None:
        return "NAT between network namespaces needs nftables (the command nft), which is missing"
    if not Path("/dev/net/tun").exists():
        return "wires between network namespaces need /dev/net/tun, which this machine lacks"
    probe = f"lndrl-probe-{os.getpid()}"
    done = subprocess.run(["ip", "netns", "add", probe], capture_output=True, encoding="utf-8")
    if done.returncode != 0:
        why = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        return f"this process may make no network namespace ({why})"
    subprocess.run(["ip", "netns", "del", probe], capture_output=True)
    return ""


@dataclass(frozen=True)
class End:
    """Where a link meets a host: ``host``'s ``interface`` has ``address`` (with its /prefix)."""

    host: str
    interface: str
    address: str


class Link:
    """A wire between two hosts, which can be made longer, worse, or cut."""

    def __init__(self, ends: tuple[End, End], process: subprocess.Popen[str]) -> None:
        self.ends = ends
        self._process = process

    def delay(self, seconds: float) -> None:
        """Each way, from now on."""
        self._say(f"delay {seconds}")

    def loss(self, share: float) -> None:
        """Of packets, each way, from now on."""
        self._say(f"loss {share}")

    def cut(self) -> None:
        """Lose everything, without a word to either end, until ``heal``."""
        self._say("cut")

    def heal(self) -> None:
        """Undo ``cut``."""
        self._say("heal")

    def carried(self) -> tuple[int, int]:
        """Bytes that came in at the first end and at the second, and arrived."""
        one, other, *_ = map(int, self._say("count").split())
        return one, other

    def close(self) -> None:
        """Take it away; can be called twice."""
        with suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _say(self, command: str) -> str:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(command + "\n")
        self._process.stdin.flush()
        return self._process.stdout.readline()


class Hosts:
    """Namespaces by name, ended with all that runs in them. Raises UserError where ``missing``."""

    def __init__(self) -> None:
        self._mark = f"lndrl{os.getpid()}"
        self._names: list[str] = []
        self._links: list[Link] = []
        self._interfaces = 0

    def __enter__(self) -> Hosts:
        if why := missing():
            raise UserError(why)
        return self

    def __exit__(self, *_: object) -> None:
        for link in self._links:
            link.close()
        for name in self._names:
            for pid in self._pids(name):
                with suppress(ProcessLookupError):
                    os.kill(pid, 9)
            subprocess.run(["ip", "netns", "del", self.namespace(name)], capture_output=True)
        self._names, self._links = [], []

    def namespace(self, name: str) -> str:
        """What the system calls a host."""
        return f"{self._mark}-{name}"

    def add(self, name: str) -> None:
        """A host that reaches nobody but itself."""
        _ip("netns", "add", self.namespace(name))
        self._names.append(name)
        self._inside(name, "link", "set", "lo", "up")

    def join(self, one: str, address: str, other: str, other_address: str) -> None:
        """A cable between two hosts; addresses are like 192.0.2.1/24."""
        here, there = self._interface(), self._interface()
        ends = (("netns", self.namespace(h)) for h in (one, other))
        first, second = ends
        _ip("link", "add", here, *first, "type", "veth", "peer", "name", there, *second)
        self._address(End(one, here, address))
        self._address(End(other, there, other_address))

    def wire(
        self, one: str, address: str, other: str, other_address: str, delay: float = 0.0,
        loss: float = 0.0, seed: int = 0,
    ) -> Link:  # fmt: skip
        """A long cable: ``delay`` s and ``loss`` (a share of packets) each way."""
        ends = End(one, self._interface(), address), End(other, self._interface(), other_address)
        command = [sys.executable, "-m", "lndrl.chaos.wire"]
        for end in ends:
            command += ["--end", f"{self.namespace(end.host)},{end.interface}"]
        command += ["--delay", str(delay), "--loss", str(loss), "--seed", str(seed)]
        process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, encoding="utf-8"
        )
        link = Link(ends, process)
        self._links.append(link)
        assert process.stdout is not None
        if process.stdout.readline() != "ready\n":
            raise UserError(f"no wire could be laid between the hosts {one} and {other}")
        for end in ends:
            self._address(end)
        return link

    def route(self, name: str, by: str, to: str = "default") -> None:
        """Let a host send what is for ``to`` to the address ``by``."""
        self._inside(name, "route", "add", to, "via", by)

    def forward(self, name: str, hide: str = "") -> None:
        """Let a host pass on what is for others; ``hide``: a network that it does NAT for."""
        self.run(name, ["sysctl", "-qw", "net.ipv4.ip_forward=1"])
        if hide:
            rules = (
                "table ip nat { chain out { type nat hook postrouting priority 100 ; "
                f"ip saddr {hide} ip daddr != {hide} masquerade ; }} ; }}"
            )
            self.run(name, ["nft", rules])

    def congestion(self, link: Link, algorithm: str) -> None:
        """Let both ends of a link send by ``algorithm``, such as cubic or bbr.

        By the route, for the kernel lets a namespace choose few as its default.
        """
        for end in link.ends:
            network = str(ipaddress.ip_interface(end.address).network)
            route = ("route", "change", network, "dev", end.interface, "congctl", algorithm)
            self._inside(end.host, *route)

    def inside(self, name: str, command: Sequence[str]) -> list[str]:
        """The command line that does ``command`` on a host."""
        return ["ip", "netns", "exec", self.namespace(name), *command]

    def run(self, name: str, command: Sequence[str], **options: Any) -> str:
        """Do ``command`` on a host; returns what it printed, raises UserError where it fails."""
        done = subprocess.run(
            self.inside(name, command), capture_output=True, encoding="utf-8", **options
        )
        if done.returncode != 0:
            words = (done.stderr.strip() or done.stdout.strip()).splitlines()
            raise UserError(f"host {name}: {' '.join(command)}: {(words or ['failed'])[-1]}")
        return done.stdout

    def start(self, name: str, command: Sequence[str], **options: Any) -> subprocess.Popen[Any]:
        """Start ``command`` on a host."""
        return subprocess.Popen(self.inside(name, command), **options)

    # -- small steps -------------------------------------------------------------------------

    def _interface(self) -> str:
        # Names of interfaces are no longer than 15 letters.
        self._interfaces += 1
        return f"w{os.getpid() % 100_000}x{self._interfaces}"

    def _address(self, end: End) -> None:
        self._inside(end.host, "addr", "add", end.address, "dev", end.interface)
        self._inside(end.host, "link", "set", end.interface, "mtu", str(_MTU), "up")

    def _inside(self, name: str, *words: str) -> None:
        _ip("-n", self.namespace(name), *words)

    def _pids(self, name: str) -> list[int]:
        done = subprocess.run(
            ["ip", "netns", "pids", self.namespace(name)], capture_output=True, encoding="utf-8"
        )
        return [int(pid) for pid in done.stdout.split()]


def _ip(*words: str) -> None:
    done = subprocess.run(["ip", *words], capture_output=True, encoding="utf-8")
    if done.returncode != 0:
        why = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UserError(f"ip {' '.join(words)}: {why}")
