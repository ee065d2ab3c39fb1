"""Several learner processes that train the same networks together, over torch.distributed.

Every rank holds the whole batch and draws the same order of it. Of each minibatch a rank evaluates
its share of the rows, and the gradients are summed over all: a step is that of one rank on the same
minibatch, but for the order in which sums are rounded.

Not by DistributedDataParallel: it hooks into each backward pass, of which a step here has several,
counts ranks where a mean over rows is wanted, and imports torch's compiler. One sum over all the
gradients of a network, after its last backward pass, is what is needed of it.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import timedelta
from ipaddress import ip_address
from typing import Any

import psutil
import torch
import torch.distributed as dist
from torch import Tensor

from lndrl.errors import UserError

TIMEOUT = 300.0
"""s that a rank waits for another: longer than any of them compiles or writes a checkpoint."""
ENVIRONMENT = ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""What torchrun sets for every process that it starts."""
HERE = "here"
"""Before the number of a rank in the store: it has come."""

_BEAT = 0.5  # s between two signs of life
_SILENT = 3.0  # s without one, after which a rank is gone


class Channel:
    """Sums over all ranks of what belongs to one network.

    One thread at a time may use it, and in the same order on every rank: two networks that train
    in two threads have one each.
    """

    def __init__(
        self, group: dist.ProcessGroup, rank: int, size: int, explained: Explained
    ) -> None:
        self._group, self._rank, self._size = group, rank, size
        self._explained = explained
        self._flat: Tensor | None = None
        self._views: list[Tensor] = []

    def share(self, rows: Tensor) -> Tensor:
        """This rank's part of ``rows`` (N,); may be empty."""
        return rows.tensor_split(self._size)[self._rank]

    def span(self, count: int) -> range:
        """This rank's part of 0 to ``count``."""
        begin, end = (count * r // self._size for r in (self._rank, self._rank + 1))
        return range(begin, end)

    def sum(self, values: Tensor) -> None:
        """Replace ``values``, contiguous, by the sum over the ranks, the same bits on each."""
        with self._explained():
            dist.all_reduce(values, group=self._group)

    def begin(self, parameters: Sequence[Tensor]) -> None:
        """Take the memory that gradients are summed in; it stays. Call it in the main thread."""
        if self._flat is not None:
            return
        sizes = [p.numel() for p in parameters]
        self._flat = torch.zeros(sum(sizes), device=parameters[0].device)
        # Laid out like the parameters: Adam goes through both side by side.
        self._views = [
            piece.as_strided(p.size(), p.stride())
            for piece, p in zip(self._flat.split(sizes), parameters, strict=True)
        ]

    @torch.no_grad()
    def sum_gradients(self, parameters: Sequence[Tensor]) -> None:
        """Replace the gradients by their sums over the ranks.

        A rank that had no row of a minibatch has no gradient, which counts as zero.
        """
        assert self._flat is not None
        given = [(v, p.grad) for v, p in zip(self._views, parameters, strict=True)]
        missing = [view for view, gradient in given if gradient is None]
        if missing:
            torch._foreach_zero_(missing)
        filled = [(view, gradient) for view, gradient in given if gradient is not None]
        if filled:
            torch._foreach_copy_([v for v, _ in filled], [g for _, g in filled])
        for parameter, view in zip(parameters, self._views, strict=True):
            parameter.grad = view
        self.sum(self._flat)


class Team:
    """The ranks of one learner; ``rank`` 0 leads: it serves actors, writes checkpoints, decides.

    Args:
        store, rank, size: of the rendezvous; every rank must make its team at the same time.
        timeout: s after which a rank that does not answer ends the job.

    Attributes:
        hosts: names of the ranks' machines.
        neighbours: ranks on this machine, which share its cores.
        place: which of them this one is, from 0.

    Every method raises UserError, which names who is gone, once another rank has ended.
    """

    def __init__(self, store: dist.Store, rank: int, size: int, timeout: float = TIMEOUT) -> None:
        self.rank, self.size = rank, size
        self._timeout = timedelta(seconds=timeout)
        self.hosts = [""] * size
        self._store = dist.PrefixStore("lndrl", store)
        self._closed = threading.Event()
        self._lost = ""  # why nothing can be said any more
        with self._told():
            store.set_timeout(self._timeout)
            dist.init_process_group(
                "gloo", store=self._store, rank=rank, world_size=size, timeout=self._timeout
            )
            self._words = dist.new_group(backend="gloo", timeout=self._timeout)
        threading.Thread(target=self._beat, name="beat", daemon=True).start()
        self.hosts = [str(word["host"]) for word in self.gather({"host": socket.gethostname()})]
        here = [r for r, host in enumerate(self.hosts) if host == self.hosts[rank]]
        self.neighbours, self.place = len(here), here.index(rank)

    @classmethod
    def of_environment(cls, timeout: float = TIMEOUT) -> Team | None:
        """The team that torchrun's variables describe; None where they describe none, or one rank.

        Raises UserError for variables that make no sense, and when the others do not come.
        """
        given = {name: os.environ.get(name, "") for name in ENVIRONMENT}
        if not all(given.values()):
            return None
        try:
            rank, size, port = (int(given[n]) for n in ("RANK", "WORLD_SIZE", "MASTER_PORT"))
            if not 0 <= rank < size:
                raise ValueError
        except ValueError:
            said = ", ".join(f"{name}={value}" for name, value in given.items())
            raise UserError(
                f"{said}: does not describe the ranks of a learner; start them with torchrun, or "
                "unset these variables"
            ) from None
        if size == 1:
            return None
        address = f"{given['MASTER_ADDR']}:{port}"
        stay_on_this_machine(given["MASTER_ADDR"])
        meet_by_interface(given["MASTER_ADDR"])
        try:
            wait = timedelta(seconds=timeout)
            store, rank, size = next(iter(dist.rendezvous("env://", timeout=wait)))
            store.set(f"{HERE}/{rank}", "")
        except (RuntimeError, ValueError, OSError):
            raise UserError(
                f"rank {rank} finds nobody at {address} (MASTER_ADDR, MASTER_PORT); start all "
                f"{size} ranks within {timeout:g} s"
            ) from None
        return cls(store, rank, size, timeout)

    def name(self, rank: int) -> str:
        """A rank in words."""
        return f"rank {rank} on {self.hosts[rank]}" if self.hosts[rank] else f"rank {rank}"

    # -- words: plain data, never pickled ------------------------------------------------------

    def say(self, word: dict[str, Any]) -> None:
        """Tell all others; only rank 0 may, and they ``hear`` it."""
        self._broadcast(json.dumps(word).encode())

    def hear(self) -> dict[str, Any]:
        """What rank 0 says next."""
        return self._plain(self._broadcast(None))

    def gather(self, word: dict[str, Any]) -> list[dict[str, Any]]:
        """The words of all ranks, by rank, on each of them."""
        return [self._plain(data) for data in self.gather_bytes(json.dumps(word).encode())]

    def gather_bytes(self, data: bytes) -> list[bytes]:
        """What all ranks give, by rank, on each of them."""
        with self._told():
            sizes = [torch.zeros(1, dtype=torch.int64) for _ in range(self.size)]
            dist.all_gather(sizes, torch.tensor([len(data)]), group=self._words)
            longest = max(1, *(int(size) for size in sizes))
            own = torch.zeros(longest, dtype=torch.uint8)
            if data:
                own[: len(data)] = torch.frombuffer(bytearray(data), dtype=torch.uint8)
            pieces = [torch.empty(longest, dtype=torch.uint8) for _ in range(self.size)]
            dist.all_gather(pieces, own, group=self._words)
        return [
            piece[: int(size)].numpy().tobytes() for piece, size in zip(pieces, sizes, strict=True)
        ]

    def spread(self, tensors: Sequence[Tensor]) -> None:
        """Give every rank what rank 0 holds, in place."""
        for tensor in tensors:
            here = tensor.detach().cpu().contiguous()
            with self._told():
                dist.broadcast(here, 0, group=self._words)
            if self.rank:
                with torch.no_grad():
                    tensor.copy_(here)

    def channels(self, device: torch.device) -> tuple[Channel, Channel]:
        """For the policy and the value network, which are on ``device``.

        A GPU is fed by one thread, and two communicators at work on it may wait for each other:
        there both share one.
        """
        with self._told():
            if device.type == "cuda":
                groups = [dist.new_group(backend="nccl", timeout=self._timeout)] * 2
            else:
                groups = [dist.new_group(backend="gloo", timeout=self._timeout) for _ in range(2)]
        one, other = (Channel(group, self.rank, self.size, self._told) for group in groups)
        return one, other

    def close(self) -> None:
        """Leave; the others must be about to leave, too. Can be called twice."""
        if not self._closed.is_set():
            self._closed.set()
            with suppress(Exception):  # of a job that has come apart
                dist.destroy_process_group()

    # -- small steps ---------------------------------------------------------------------------

    def _broadcast(self, data: bytes | None) -> bytes:
        with self._told():
            size = torch.tensor([0 if data is None else len(data)])
            dist.broadcast(size, 0, group=self._words)
            content = torch.empty(int(size), dtype=torch.uint8)
            if data is not None:
                content = torch.frombuffer(bytearray(data), dtype=torch.uint8)
            dist.broadcast(content, 0, group=self._words)
        return content.numpy().tobytes()

    def _plain(self, data: bytes) -> dict[str, Any]:
        word = json.loads(data)
        assert isinstance(word, dict)
        return word

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Say in a sentence what torch says of a rank that is gone."""
        if self._lost:
            raise UserError(self._lost)
        try:
            yield
        except RuntimeError as error:
            self._lost = self._lost or self._who_is_gone(error)
            raise UserError(self._lost) from None

    def _who_is_gone(self, error: RuntimeError) -> str:
        before = self._beats()
        time.sleep(_SILENT)
        after = self._beats()
        if before is None or after is None:
            gone = [0] if self.rank else []
        else:
            gone = [r for r in range(self.size) if after[r] == before[r] and r != self.rank]
        if not gone:
            first = str(error).strip().splitlines()[0] if str(error).strip() else "no reason"
            return f"the ranks have lost each other ({first[:200]}); {_AGAIN}"
        names = " and ".join(self.name(rank) for rank in gone)
        return f"{names} {'is' if len(gone) == 1 else 'are'} gone; {_AGAIN}"

    def _beats(self) -> list[int] | None:
        """Signs of life of all ranks so far; None where nobody keeps count any more."""
        try:
            return [self._store.add(f"beat/{rank}", 0) for rank in range(self.size)]
        except RuntimeError:
            return None

    def _beat(self) -> None:
        with suppress(RuntimeError):
            while not self._closed.wait(_BEAT):
                self._store.add(f"beat/{self.rank}", 1)


Explained = Callable[[], Any]
"""Makes a context in which errors of torch.distributed become sentences."""

_AGAIN = (
    "the job ends here; what is trained is in the last checkpoint, and --resume goes on with any "
    "number of ranks"
)


def meet_by_interface(address: str) -> None:
    """Let gloo use the interface that leads to ``address`` where this host's own name does not.

    gloo takes the address of that name, which many systems (Debian's 127.0.1.1) have point to the
    loopback: ranks on other machines would find nobody there.
    """
    try:
        if not ip_address(socket.gethostbyname(socket.gethostname())).is_loopback:
            return
    except OSError:
        pass  # a name that nobody knows leads nowhere, either
    with suppress(OSError):
        family, _, _, _, there = socket.getaddrinfo(address, 1, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect(there)  # sends nothing
            mine = probe.getsockname()[0]
        for interface, addresses in psutil.net_if_addrs().items():
            if any(each.address.partition("%")[0] == mine for each in addresses):
                os.environ.setdefault("GLOO_SOCKET_IFNAME", interface)
                return


def stay_on_this_machine(address: str) -> None:
    """Let gloo use the loopback where all ranks are here: a host's own name may lead nowhere."""
    if address in ("127.0.0.1", "localhost", "::1"):
        os.environ.setdefault("GLOO_SOCKET_IFNAME", "lo")
