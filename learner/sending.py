"""Weights as they are sent to actors: whole, or in half precision at half the bytes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.policy import Network, to_bytes
from lndrl.policy.shipped import narrowed


class Sender:
    """Makes blobs of networks for actors, as ``transport.weights`` says.

    ``tell`` hears once when that cannot be: numbers that half precision does not have go whole.
    """

    def __init__(self, config: RunConfig, tell: Callable[[str], None]) -> None:
        self.rounds = config.transport.weights == "float16"
        self._tell = tell
        self._told = False

    def __call__(self, network: Network, metadata: Mapping[str, str]) -> bytes:
        """The weights of ``network`` with ``metadata``."""
        blob = to_bytes(network, dict(metadata))
        if not self.rounds:
            return blob
        try:
            return narrowed(blob, metadata)
        except UserError as error:
            if not self._told:
                self._told = True
                self._tell(f"sent in float32 after all, {str(error).partition(';')[0]}")
            return blob
