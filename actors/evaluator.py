"""An evaluator: plays the same validation episodes with the newest weights, again and again.

The same object runs in a process of its own (``run``) and in the learner's thread over the
in-memory transport (``round``). It only reads weights and tells counts, so training goes the same
way with it and without.
"""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
import time
from collections.abc import Callable

from lndrl import kernels
from lndrl.config import RunConfig, parse_config
from lndrl.evaluation.validation import ValidationEpisodes
from lndrl.transport import (
    NO_WEIGHTS,
    EvaluatorEndpoint,
    EvaluatorHello,
    LearnerUnreachableError,
    ValidationResult,
    ValidationTask,
    WeightsGoneError,
)
from lndrl.version import VERSION
from lndrl.wording import counted

HELLO_TIMEOUT = 10.0
PATIENT_TIMEOUT = 2.0  # s per attempt, between which a stop is noticed
ASK_EVERY = 2.0  # s while there is nothing new, or while it rests


class Evaluator:
    """Validates for the learner behind ``endpoint``.

    ``evaluator_id`` names the place of this evaluator across restarts, ``incarnation`` this life of
    it. ``patient`` waits for a learner that does not answer instead of failing; one that was there
    once is always waited for. ``on_event(event, text)`` hears of joined, starting, validated and
    the like.
    """

    def __init__(
        self,
        endpoint: EvaluatorEndpoint,
        *,
        evaluator_id: str = "",
        incarnation: str = "",
        patient: bool = False,
        on_event: Callable[[str, str], None] = lambda event, text: None,
    ) -> None:
        self.endpoint = endpoint
        self.evaluator_id = evaluator_id or f"evaluator-{secrets.token_hex(4)}"
        self.incarnation = incarnation or secrets.token_hex(8)
        self.done = False
        self._patient = patient
        self._on_event = on_event
        self._told = ""  # the configuration as the learner gave it last, as JSON
        self._run_id = ""
        self._config: RunConfig | None = None
        self._episodes: ValidationEpisodes | None = None

    def run(self, stop: threading.Event) -> None:
        """Validate until the learner is done or ``stop`` is set.

        Between two rounds it rests, so that it takes ``learner.validation_share`` of a core on
        average. Raises UserError when the learner cannot be reached (unless patient), refuses this
        evaluator, or hands out what this program cannot use.
        """
        rested = time.monotonic()
        while not (stop.is_set() or self.done):
            task = self._ask(time.monotonic() >= rested, stop.is_set)
            if task is None or task.version == NO_WEIGHTS:
                stop.wait(0.0 if self.done else ASK_EVERY)
                continue
            began, worked = time.monotonic(), time.process_time()
            if self._validate(task, stop.is_set):
                worked = time.process_time() - worked
                rested = began + worked / self.config.learner.validation_share

    def round(self, stopped: Callable[[], bool] = bool) -> bool:
        """Validate the newest weights now; False where they were before, or ``stopped()``."""
        task = self._ask(True, stopped)
        return task is not None and task.version != NO_WEIGHTS and self._validate(task, stopped)

    @property
    def config(self) -> RunConfig:
        """The run's configuration, as the learner gave it; needs a task."""
        assert self._config is not None
        return self._config

    def _ask(self, ready: bool, stopped: Callable[[], bool]) -> ValidationTask | None:
        """What the learner wants; None when ``stopped()`` before one answered."""
        hello = EvaluatorHello(
            self.evaluator_id,
            self.incarnation,
            socket.gethostname(),
            os.getpid(),
            VERSION,
            ready=ready,
        )
        while not stopped():
            patient = self._patient or self._config is not None
            began = time.monotonic()
            try:
                task = self.endpoint.ask(hello, PATIENT_TIMEOUT if patient else HELLO_TIMEOUT)
            except LearnerUnreachableError:
                if not patient:
                    raise
                # An unknown host is found out at once; it need not be asked for without pause.
                time.sleep(max(0.0, PATIENT_TIMEOUT - (time.monotonic() - began)))
                continue
            self._join(task)
            self.done = task.done
            return task
        return None

    def _join(self, task: ValidationTask) -> None:
        """Make ready for the run that the learner describes, unless that is done."""
        told = json.dumps(task.config, sort_keys=True)
        if told == self._told and task.run_id == self._run_id:
            return
        config = parse_config(task.config, "configuration from the learner")
        again = self._config is not None
        episodes = config.learner.validation_episodes
        self._told, self._run_id, self._config = told, task.run_id, config
        self._episodes = ValidationEpisodes(config, episodes)
        self._on_event(
            "joined again" if again else "joined",
            f"run {task.run_id}, {counted(episodes, 'validation episode')} a round",
        )

    def _validate(self, task: ValidationTask, stopped: Callable[[], bool]) -> bool:
        """Play the episodes under the weights of ``task`` and tell; whether the learner heard."""
        assert self._episodes is not None
        began = time.monotonic()
        try:
            weights = self.endpoint.fetch(task.version)
        except (WeightsGoneError, TimeoutError):
            return False
        with kernels.told(kernels.Lines(lambda text: self._on_event("starting", text))):
            sampled = self._episodes(weights, False, stopped)
            greedy = None if sampled is None else self._episodes(weights, True, stopped)
        if sampled is None or greedy is None:
            return False
        seconds = time.monotonic() - began
        result = ValidationResult(
            self._run_id,
            self.evaluator_id,
            self.incarnation,
            task.learner_incarnation,
            task.version,
            seconds,
            sampled,
            greedy,
        )
        return self._report(result, stopped)

    def _report(self, result: ValidationResult, stopped: Callable[[], bool]) -> bool:
        """Tell until a learner answers; one that was restarted does not want it any more."""
        while not stopped():
            ack = self.endpoint.report(result, PATIENT_TIMEOUT)
            if ack is None:
                continue
            if ack.status in ("stale", "refused"):
                self._on_event(ack.status, ack.reason)
            else:
                share = result.sampled["arrived"] / result.sampled["episodes"]
                text = f"version {result.version}: {share:.2f} arrived, {result.seconds:.0f} s"
                self._on_event("validated", text)
            return True
        return False
