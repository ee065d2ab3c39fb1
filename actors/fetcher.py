"""Weights fetched beside the simulation, so that 30 MB on their way keep no world waiting."""

from __future__ import annotations

import threading

from lndrl.transport import ActorEndpoint

FETCH_TIMEOUT = 120.0
"""s that weights may be on their way. Asked again sooner, a slow link would carry them twice and
never be done; one that breaks ends the question at once."""


class Fetcher:
    """Fetches the newest weights of ``endpoint`` in a thread, one fetch at a time."""

    def __init__(self, endpoint: ActorEndpoint) -> None:
        self._endpoint = endpoint
        self._thread: threading.Thread | None = None
        self._learner = ""
        self._result: tuple[int, bytes] | BaseException | None = None

    def begin(self, learner: str) -> None:
        """Start a fetch from ``learner`` (its incarnation), unless there is one already."""
        if self._thread is None:
            self._learner = learner
            # Daemon: a learner that does not answer must not keep the process alive.
            self._thread = threading.Thread(target=self._fetch, name="weights", daemon=True)
            self._thread.start()

    def take(self, learner: str) -> tuple[int, bytes] | None:
        """(version, blob) of a fetch from ``learner`` that has ended; None while there is none.

        Raises what the fetch raised, but for a timeout, after which there is just nothing.
        """
        if self._thread is None or self._thread.is_alive():
            return None
        result, self._thread, self._result = self._result, None, None
        if self._learner != learner:
            return None
        if isinstance(result, BaseException) and not isinstance(result, TimeoutError):
            raise result
        return result if isinstance(result, tuple) else None

    def _fetch(self) -> None:
        try:
            self._result = self._endpoint.fetch(None, FETCH_TIMEOUT)
        except Exception as error:
            self._result = error
