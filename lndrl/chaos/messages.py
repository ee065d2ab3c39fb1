"""Messages that no honest program sends, drawn from a seed: the material of ``lndrl chaos --fuzz``.

    forger = Forger(config, run_id, version=3, seed=1)
    message = forger.draw()

``hopeless`` ones must never be taken, whatever the learner does with them; the others are damaged
where a message can change without becoming wrong (a bit of a scan, say), so either is right.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgpack
import numpy as np
from numpy.typing import NDArray

from lndrl.chaos.forged import forged_arrays, forged_header, forged_hello
from lndrl.config import RunConfig
from lndrl.transport.messages import ChunkHeader, Hello, encode
from lndrl.transport.wire import ALIGNMENT, DTYPES, MAGIC, pack

ACTOR = "fuzz"
UPLOAD, HELLO = "lndrl/upload", "lndrl/hello"
QUERIES = ("lndrl/weights", "lndrl/status", "lndrl/announce", "lndrl/ping")
KEYS = (*QUERIES, HELLO, UPLOAD)
STRANGE_VALUES: tuple[Any, ...] = (
    None, True, -1, 2**53, -(2**62), 1.5, float("nan"), float("inf"), "", "x" * 5000, "a/b", "*",
    "\x00", "é", b"\xff\x00", [], [[[]]], {}, {"a": {"b": 1}},
)  # fmt: skip


@dataclass(frozen=True)
class Malformed:
    """One message. ``way``: query, put or token; ``what``: how it was made."""

    what: str
    way: str
    key: str
    payload: bytes = b""
    hopeless: bool = True

    @property
    def kind(self) -> str:
        """What it pretends to be: upload, hello, weights, ..."""
        parts = self.key.split("/")
        return parts[1] if len(parts) > 1 else parts[0]


class Forger:
    """Draws messages against the run that ``config`` and ``run_id`` describe.

    ``version`` is the newest weights version that the run may have. Everything follows from
    ``seed``. Uploads are of the actor ``actor``, so whatever is taken of them can be told apart.
    """

    def __init__(
        self, config: RunConfig, run_id: str, version: int = 0, seed: int = 0, actor: str = ACTOR
    ) -> None:
        self.random = random.Random(f"fuzz {seed}")
        self._run_id, self._actor = run_id, actor
        self._life = f"{self.random.randrange(2**32):08x}"
        self._sequence = 0
        numbers = np.random.default_rng(seed)
        self._arrays = forged_arrays(config, numbers, 2, version)
        self._steps = config.actor.horizon
        self._makers: list[tuple[int, Callable[[], Malformed]]] = [
            (3, self._noise),
            (3, self._cut),
            (3, self._flipped),
            (2, self._longer),
            (2, self._head),
            (4, self._table),
            (5, self._wrong_array),
            (8, self._wrong_value),
            (8, self._wrong_header),
            (2, self._wrong_kind),
            (6, self._wrong_hello),
            (3, self._query),
            (3, self._put),
            (2, self._token),
            (1, self._unknown_key),
        ]

    def draw(self) -> Malformed:
        """The next message."""
        weights = [weight for weight, _ in self._makers]
        (maker,) = self.random.choices([make for _, make in self._makers], weights)
        return maker()

    def header(self, **changes: Any) -> dict[str, Any]:
        """The fields of a valid upload's header, with ``changes``."""
        self._sequence += 1
        plain = forged_header(self._run_id, self._actor, self._life, self._sequence, self._steps, 2)
        return plain.to_dict() | changes

    def valid(self) -> bytes:
        """An upload that a learner takes."""
        return encode(ChunkHeader(**self.header()), self._arrays)

    # -- uploads -----------------------------------------------------------------------------

    def _upload(self, what: str, payload: bytes, hopeless: bool = True) -> Malformed:
        key = f"{UPLOAD}/{self._actor}/{self._life}/{self._sequence}"
        return Malformed(what, "query", key, payload, hopeless)

    def _packed(
        self,
        what: str,
        header: dict[str, Any] | None = None,
        arrays: dict[str, NDArray[Any]] | None = None,
        hopeless: bool = True,
    ) -> Malformed:
        body = {"kind": "chunk", "body": self.header() if header is None else header}
        payload = pack(body, self._arrays if arrays is None else arrays)
        return self._upload(what, payload, hopeless)

    def _noise(self) -> Malformed:
        size = self.random.choice([0, 1, 7, 12, 100, 5000])
        start = self.random.choice([b"", MAGIC, MAGIC + b"\xff" * 4])
        return self._upload("noise", start + self.random.randbytes(size))

    def _cut(self) -> Malformed:
        whole = self.valid()
        return self._upload("truncated", whole[: self.random.randrange(len(whole))])

    def _flipped(self) -> Malformed:
        data = bytearray(self.valid())
        # Half of them in the head, where structure is.
        limit = self.random.choice([600, len(data)])
        for _ in range(self.random.randint(1, 8)):
            data[self.random.randrange(limit)] ^= 1 << self.random.randrange(8)
        return self._upload("bits flipped", bytes(data), hopeless=False)

    def _longer(self) -> Malformed:
        whole, more = self.valid(), self.random.randbytes(self.random.randint(1, 4096))
        if self.random.random() < 0.5:
            return self._upload("bytes behind the end", whole + more)
        place = self.random.randrange(len(whole))
        return self._upload("bytes in the middle", whole[:place] + more + whole[place:])

    def _head(self) -> Malformed:
        """Heads that lie about their length, or are huge, deep or of odd types."""
        length = self.random.choice([0, 1, 2**31, 2**32 - 1, 5 * 2**20])
        deep: Any = "end"
        for _ in range(self.random.choice([30, 400, 900])):
            deep = [deep] if self.random.random() < 0.5 else {"a": deep}
        head = self.random.choice(
            [
                b"",
                b"\xdf\xff\xff\xff\xff",  # a map of 4 billion entries
                b"\xdd\xff\xff\xff\xff",  # a list of as many
                b"\xc6\xff\xff\xff\xff",  # bytes of 4 GB
                b"\x91" * 100_000,
                msgpack.packb([{"kind": "chunk", "body": deep}, []]),
                msgpack.packb([{1: 2}, []]),
                msgpack.packb([{}, [], []]),
                msgpack.packb({"kind": "chunk"}),
                msgpack.packb([msgpack.ExtType(1, b"x"), []]),
                msgpack.packb([{"kind": "chunk", "body": "x" * (5 * 2**20)}, []]),
            ]
        )
        if self.random.random() < 0.7:
            length = len(head)
        return self._upload("head", MAGIC + length.to_bytes(4, "little") + head)

    def _table(self) -> Malformed:
        """Tables of arrays that the bytes behind them do not hold."""
        rows = [
            ["a", "<f4", [2**31 - 1] * 8],
            ["a", "<f4", [2**62]],
            ["a", "<f4", [-1, 4]],
            ["a", "<f4", [1] * 9],
            ["a", "|O", [1]],
            ["a", "<U4", [1]],
            ["a", "<f4", "4"],
            ["../a", "<f4", [1]],
            ["a", "<f4"],
            [1, 2, 3],
            "a",
            ["reward", "<f4", [0, 2**31 - 1]],
            ["reward", "<f8", [10**9]],
        ]
        table = [self.random.choice(rows) for _ in range(self.random.choice([1, 2, 70]))]
        body = {"kind": "chunk", "body": self.header()}
        head = msgpack.packb([body, table])
        start = MAGIC + len(head).to_bytes(4, "little") + head
        gap = bytes(-len(start) % ALIGNMENT)
        return self._upload("table", start + gap + bytes(self.random.choice([0, 4, 4096])))

    def _wrong_array(self) -> Malformed:
        """An array that is missing, too many, of another name, type or shape."""
        arrays = dict(self._arrays)
        name = self.random.choice(list(arrays))
        array = arrays[name]
        case = self.random.randrange(6)
        if case == 0:
            del arrays[name]
        elif case == 1:
            arrays["extra"] = array
        elif case == 2:
            arrays[name.upper()] = arrays.pop(name)
        elif case == 3:
            others = [dtype for dtype in DTYPES.values() if dtype != array.dtype]
            arrays[name] = array.astype(self.random.choice(others))
        elif case == 4:
            arrays[name] = array[None]
        else:
            arrays[name] = np.concatenate([array, array])
        return self._packed(f"array {name} ({case})", arrays=arrays)

    def _wrong_value(self) -> Malformed:
        """A number that is not finite, out of its range, or of weights that do not exist yet."""
        nan, infinite = float("nan"), float("inf")
        name, value = self.random.choice(
            [
                ("reward", nan), ("reward", infinite), ("reward", -infinite), ("reward", 1e30),
                ("log_prob", nan), ("log_prob", -infinite), ("log_prob", 0.5),
                ("goal", nan), ("goal", infinite), ("goal", 1e9),
                ("final_goal", nan), ("final_goal", -1e30),
                ("pedestrian_rows", nan), ("pedestrian_rows", 1e9),
                ("action", 255), ("terminated", 2), ("truncated", 255),
                ("pedestrian_count", 255), ("final_index", -1), ("final_index", 10**6),
                ("version", 2**32 - 1),
            ]
        )  # fmt: skip
        array = self._arrays[name].copy()
        if not array.size:
            return self._cut()
        array.reshape(-1)[self.random.randrange(array.size)] = value
        return self._packed(f"{name} = {value}", arrays={**self._arrays, name: array})

    def _wrong_header(self) -> Malformed:
        """A header of another run, or with a field that cannot be."""
        changes: list[tuple[str, Any]] = [
            ("run_id", "another-run"),
            ("run_id", ""),
            ("actor_id", "a/b"),
            ("actor_id", "../../etc"),
            ("incarnation", "x" * 65),
            ("sequence", -1),
            ("sequence", 2**60),
            ("steps", 5),
            ("worlds", 10**6),
            ("worlds", 0),
            ("episodes", [{}]),
            ("episodes", [{"outcome": "won"}] * 1000),
            ("timing", {"simulate": float("nan")}),
            ("timing", {"simulate": 10**400}) if self.random.random() < 0 else ("timing", [1]),
            ("surprise", 1),
        ]
        name, value = self.random.choice(changes)
        if self.random.random() < 0.5:
            field = self.random.choice(["run_id", "actor_id", "incarnation", "worlds", "episodes"])
            strange = [v for v in STRANGE_VALUES if not (field == "episodes" and v == [])]
            name, value = field, self.random.choice(strange)
            # A whole number is a number of worlds, but the arrays hold another.
        header = self.header(**{name: value})
        if self.random.random() < 0.1:
            del header[name]
            name, value = f"no {name}", ""
            if name == "no episodes" or name == "no timing" or name == "no surprise":
                header["run_id"] = "another-run"
        return self._packed(f"header {name} = {str(value)[:20]}", header=header)

    def _wrong_kind(self) -> Malformed:
        kind = self.random.choice(["hello", "ack", "weights", "welcome", "", None, 7, "chunk\x00"])
        message = {"kind": kind, "body": self.header()}
        if self.random.random() < 0.3:
            message = {"kind": "chunk", "body": self.header(), "more": 1}
        return self._upload("kind", pack(message, self._arrays))

    # -- everything else ---------------------------------------------------------------------

    def _wrong_hello(self) -> Malformed:
        """Hellos of other versions, with wrong fields, cut, flipped or noise."""
        fields = forged_hello(f"{self._actor}-hello", self._life).to_dict()
        case = self.random.randrange(6)
        hopeless = True
        if case == 0:
            fields["protocol"] = self.random.choice([0, 2, 10**6])
        elif case == 1:
            fields["program_version"] = self.random.choice(["", "0.0.0", "9" * 2000])
        elif case == 2:
            del fields[self.random.choice(["actor_id", "incarnation", "host", "pid", "worlds"])]
        elif case == 3:
            name = self.random.choice(["actor_id", "incarnation", "worlds", "protocol"])
            fields[name] = self.random.choice(STRANGE_VALUES)
        else:
            data = bytearray(encode(Hello(**fields)))
            if case == 4:
                del data[self.random.randrange(len(data)) :]
            else:
                data[self.random.randrange(len(data))] ^= 1 << self.random.randrange(8)
                hopeless = False
            return Malformed("hello damaged", "query", HELLO, bytes(data), hopeless)
        payload = pack({"kind": "hello", "body": fields})
        return Malformed("hello fields", "query", HELLO, payload)

    def _query(self) -> Malformed:
        """Questions that need no content, with content."""
        payloads = [
            b"-1",
            b"9" * 400,
            "²³".encode(),
            b"\xff",
            b"1e9",
            self.random.randbytes(100_000),
        ]
        key = self.random.choice(QUERIES)
        return Malformed("query", "query", key, self.random.choice(payloads), hopeless=False)

    def _put(self) -> Malformed:
        """Samples where the learner expects questions, and statuses that it never wrote."""
        payloads = [b"", b"null", b'{"snapshot": 1}', self.valid(), self.random.randbytes(10_000)]
        key = self.random.choice([*KEYS, f"{UPLOAD}/{self._actor}/{self._life}/1"])
        return Malformed("put", "put", key, self.random.choice(payloads))

    def _token(self) -> Malformed:
        names = [
            "x",
            "a/b/c",
            "a/b/c/d/e",
            "é/ü",
            "x" * 500 + "/1",
            "@/1",
            "-/-",
            " / ",
            f"{self._actor}/%00",
        ]
        return Malformed("token", "token", f"lndrl/actors/{self.random.choice(names)}")

    def _unknown_key(self) -> Malformed:
        keys = [
            "lndrl/nothing",
            "lndrl",
            "lndrl/**",
            "lndrl/upload/**",
            "**",
            "lndrl/hello/x",
            "other/upload",
        ]
        payload = self.random.choice([b"", self.random.randbytes(1000)])
        return Malformed("unknown key", "query", self.random.choice(keys), payload)
