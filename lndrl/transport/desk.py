"""What a learner answers, whatever carries question and answer. Thread-safe."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
import secrets
import threading
from typing import Any

import numpy as np

from lndrl.transport import operation
from lndrl.transport.interface import LearnerHandlers, ValidationHandlers
from lndrl.transport.keys import ACTORS
from lndrl.transport.messages import (
    NO_WEIGHTS,
    PROTOCOL_VERSION,
    Ack,
    ChunkHeader,
    EvaluatorHello,
    Hello,
    Limits,
    MessageError,
    Refusal,
    ValidationResult,
    ValidationTask,
    WeightsAnnouncement,
    Welcome,
    decode,
    digest,
    encode,
)
from lndrl.transport.traffic import Traffic
from lndrl.version import VERSION

KEPT_VERSIONS = 2
logger = logging.getLogger(__name__)


class LearnerDesk:
    """Decodes questions, asks the handlers, stamps and encodes answers; keeps weights, status."""

    def __init__(self, limits: Limits, run_id: str = "", incarnation: str = "") -> None:
        """``incarnation``: that of the learner whose rank this is; by default a new one."""
        self.incarnation = incarnation or secrets.token_hex(8)
        self.limits = limits
        self.run_id = run_id
        self.handlers: LearnerHandlers | None = None
        self.validation: ValidationHandlers | None = None
        self.operator: operation.OperatorHandlers | None = None
        self.traffic = Traffic()
        self._lock = threading.Lock()
        self._weights: dict[int, tuple[WeightsAnnouncement, bytes]] = {}
        self._tested: dict[int, tuple[WeightsAnnouncement, bytes]] = {}  # where they are others
        self._newest = WeightsAnnouncement(NO_WEIGHTS, 0, "", self.incarnation)
        self._status: tuple[dict[str, Any], list[dict[str, Any]]] | None = None
        self._rows: dict[int, tuple[dict[str, Any], bytes]] = {}  # of the history, by identity

    def answer_hello(self, data: bytes) -> bytes:
        """Welcome or refusal to an encoded Hello; a wrong protocol is refused here."""
        try:
            hello, _ = decode(data, Hello, limits=self.limits)
        except MessageError as error:
            return encode(
                Refusal(
                    f"the learner (protocol {PROTOCOL_VERSION}) does not understand this actor's"
                    f" hello ({str(error)[:500]}); install the same lndrl version on both sides"
                )
            )
        if hello.protocol != PROTOCOL_VERSION:
            return encode(
                Refusal(
                    f"the learner speaks protocol {PROTOCOL_VERSION}, this actor"
                    f" {hello.protocol}; install the same lndrl version on both sides"
                )
            )
        answer = self._handlers().on_hello(hello)
        if isinstance(answer, Welcome):
            answer = dataclasses.replace(
                answer,
                weights_version=self.announcement().version,
                learner_incarnation=self.incarnation,
            )
        return encode(answer)

    def answer_ping(self) -> bytes:
        """Versions and run as JSON, for whoever wonders what answers here."""
        with self._lock:
            snapshot = self._status[0] if self._status is not None else {}
        # A service takes its port before it makes the run; then only the status knows the name.
        run_id = self.run_id or snapshot.get("run_id", "")
        versions = {"program_version": VERSION, "protocol": PROTOCOL_VERSION}
        return to_json({**versions, "run_id": run_id})

    def answer_chunk(self, data: bytes) -> Ack:
        """Ack to an encoded chunk; malformed ones are refused here, handlers may block."""
        try:
            header, arrays = decode(data, ChunkHeader, limits=self.limits)
        except MessageError as error:
            self._handlers().on_malformed(str(error)[:500])
            return self._stamped(Ack("refused", reason=f"malformed: {error}"[:500]))
        try:
            ack = self._handlers().on_chunk(header, arrays, len(data))
        except Exception:
            logger.exception("upload %d of %s failed", header.sequence, header.actor_id)
            ack = Ack("refused", reason="learner_error")
        return self._stamped(ack)

    def answer_validation(self, data: bytes) -> bytes:
        """Task, Ack or refusal to what an evaluator asks or tells; a wrong protocol is refused."""
        try:
            question, _ = decode(data, EvaluatorHello, ValidationResult, limits=self.limits)
        except MessageError as error:
            return encode(
                Refusal(
                    f"the learner (lndrl {VERSION}, protocol {PROTOCOL_VERSION}) does not"
                    f" understand this evaluator ({str(error)[:500]}); install the same lndrl"
                    " version on both sides"
                )
            )
        if self.validation is None:
            return encode(Refusal("this learner takes no evaluator"))
        if isinstance(question, EvaluatorHello):
            if question.protocol != PROTOCOL_VERSION:
                return encode(
                    Refusal(
                        f"the learner speaks protocol {PROTOCOL_VERSION}, this evaluator"
                        f" {question.protocol}; install the same lndrl version on both sides"
                    )
                )
            answer = self.validation.on_evaluator(question)
            if isinstance(answer, ValidationTask):
                answer = dataclasses.replace(
                    answer,
                    learner_incarnation=self.incarnation,
                    done=answer.done or self.announcement().done,
                )
            return encode(answer)
        assert isinstance(question, ValidationResult)
        return encode(self._stamped(self.validation.on_validation(question)))

    def answer_request(self, data: bytes) -> bytes:
        """Whether an operator gets what it asks for."""
        return operation.answer(data, self.operator, self.limits)

    def heard_of(self, key: str, alive: bool) -> None:
        """Tell the handlers of an actor whose token appeared or vanished."""
        parts = key.removeprefix(f"{ACTORS}/").split("/")
        if len(parts) == 2 and self.handlers is not None:
            self.handlers.on_member(parts[0], parts[1], alive)

    def put_weights(
        self, version: int, blob: bytes, tested: bytes | None = None
    ) -> WeightsAnnouncement:
        """Keep weights as the newest; ``tested`` is what evaluators get, if it is not ``blob``.

        Raises ValueError for a version older than the newest.
        """
        if not blob:
            raise ValueError("weights must not be empty")
        with self._lock:
            if version < self._newest.version:
                raise ValueError(f"version {version} is older than {self._newest.version}")
            self._newest = WeightsAnnouncement(
                version, len(blob), digest(blob), self.incarnation, self._newest.done
            )
            self._weights[version] = (self._newest, blob)
            self._tested.pop(version, None)
            if tested is not None:
                news = dataclasses.replace(self._newest, size=len(tested), digest=digest(tested))
                self._tested[version] = (news, tested)
            for old in sorted(self._weights)[:-KEPT_VERSIONS]:
                del self._weights[old]
                self._tested.pop(old, None)
            return self._newest

    def note_version(self, version: int) -> None:
        """Say in acknowledgements that there are weights of this version, kept elsewhere."""
        with self._lock:
            self._newest = dataclasses.replace(self._newest, version=version)

    def weights(self, version: int | None) -> tuple[WeightsAnnouncement, bytes] | None:
        """The weights of a version (None: the newest), or None if they are not here."""
        with self._lock:
            found = self._weights.get(self._newest.version if version is None else version)
        return self._handed_out(found)

    def tested(self, version: int) -> tuple[WeightsAnnouncement, bytes] | None:
        """What evaluators test of a version, or None if it is not here."""
        with self._lock:
            found = self._tested.get(version) or self._weights.get(version)
        return self._handed_out(found)

    def announcement(self) -> WeightsAnnouncement:
        """What the newest weights are."""
        with self._lock:
            return self._newest

    def finish(self) -> WeightsAnnouncement:
        """Say ``done`` from now on."""
        with self._lock:
            self._newest = dataclasses.replace(self._newest, done=True)
            return self._newest

    def put_status(self, snapshot: dict[str, Any], history: list[dict[str, Any]]) -> None:
        """Keep the newest status; the list is copied, its rows must not change any more."""
        with self._lock:
            self._status = (snapshot, list(history))

    def status(self) -> bytes | None:
        """Snapshot and history as JSON, None before the first."""
        with self._lock:
            status = self._status
        if status is None:
            return None
        snapshot, history = status
        # Who asks again and again pays for the new rows, not for hundreds of old ones each time.
        known = self._rows
        self._rows = {id(row): known.get(id(row)) or (row, to_json(row)) for row in history}
        rows = b", ".join(self._rows[id(row)][1] for row in history)
        return b'{"snapshot": ' + to_json(snapshot) + b', "history": [' + rows + b"]}"

    def _handed_out(
        self, found: tuple[WeightsAnnouncement, bytes] | None
    ) -> tuple[WeightsAnnouncement, bytes] | None:
        if found is not None:
            self.traffic.handed_out(len(found[1]))
        return found

    def _handlers(self) -> LearnerHandlers:
        if self.handlers is None:
            raise RuntimeError("the learner has not started to answer")
        return self.handlers

    def _stamped(self, ack: Ack) -> Ack:
        newest = self.announcement()
        return dataclasses.replace(
            ack,
            weights_version=newest.version,
            learner_incarnation=self.incarnation,
            done=ack.done or newest.done,
        )


def to_json(value: Any) -> bytes:
    """JSON that every parser reads: NaN and infinity become null, numpy scalars plain numbers."""
    try:
        return json.dumps(value, allow_nan=False, default=_scalar).encode()
    except ValueError:
        return json.dumps(_finite(value), allow_nan=False, default=_scalar).encode()


def _scalar(value: Any) -> Any:
    if isinstance(value, np.generic):
        return _finite(value.item())
    raise TypeError(f"a status cannot hold a {type(value).__name__}")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
