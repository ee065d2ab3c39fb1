"""What would never arrive, found before anybody waits for it: each side's limits, compared.

A message that is larger than its receiver allows vanishes on the way without a word, so whoever
knows both sides says it first: the learner when it starts, and to an actor that says hello.
"""

from __future__ import annotations

import math

from lndrl.config import RunConfig
from lndrl.errors import UserError
from lndrl.navigation.trajectory import most_bytes
from lndrl.transport import DEFAULT_LIMITS, Welcome
from lndrl.transport.messages import encode

_MEBIBYTE = 2**20


def check_messages(config: RunConfig, weights: int, largest: int) -> None:
    """Raises UserError where a run could not go on because its messages do not fit.

    ``weights`` are the bytes of a version, ``largest`` those of a message that is received here.
    """
    sentence = chunk_too_large(config, config.worlds_per_actor(1), largest)
    if sentence:
        raise UserError(sentence)
    allowed = config.transport.max_message_megabytes * _MEBIBYTE
    if weights > allowed:
        raise UserError(
            f"the weights take {weights / _MEBIBYTE:.3g} MiB, more than"
            f" transport.max_message_megabytes {config.transport.max_message_megabytes} lets the"
            " actors receive; raise it"
        )
    welcome = len(encode(Welcome("-" * 64, config.model_dump(mode="json"), 0)))
    if welcome > DEFAULT_LIMITS.max_head_bytes:
        raise UserError(
            f"the configuration takes {welcome / _MEBIBYTE:.3g} MiB with the map in it, and actors"
            f" receive {DEFAULT_LIMITS.max_head_bytes / _MEBIBYTE:.3g}; crop the map or give it a"
            " coarser resolution"
        )


def check_queue(config: RunConfig) -> None:
    """Raises UserError where a batch that has grown may not find room in the queue: the learner
    would wait for ever for what it does not let in.
    """
    final = config.ppo.batch_size_final
    if final is None:
        return
    horizon = config.actor.horizon
    chunks = -(-final // horizon)  # of one world each, which have the most finals beside them
    # People lie unpacked beside the message, see ``memory_of``.
    megabytes = 2 * chunks * most_bytes(config, 1) / 1e6
    if megabytes > config.learner.queue_megabytes:
        raise UserError(
            f"learner.queue_megabytes {config.learner.queue_megabytes} may not hold a batch of "
            f"ppo.batch_size_final {final:,} samples, which take up to {math.ceil(megabytes)}; "
            "raise it or lower batch_size_final"
        )


def chunk_too_large(config: RunConfig, worlds: int, largest: int) -> str:
    """A sentence where a chunk of ``worlds`` worlds may exceed ``largest`` bytes, else nothing."""
    size = most_bytes(config, worlds)
    if size <= largest:
        return ""
    configured = config.transport.max_message_megabytes
    limit = f"transport.max_message_megabytes {configured}"
    if largest < configured * _MEBIBYTE:
        limit = f"transport/link/rx/max_message_size {largest} in the zenoh settings"
    return (
        f"a chunk of {worlds} worlds and {config.actor.horizon} steps may take"
        f" {size / _MEBIBYTE:.3g} MiB, more than {limit} of the learner lets in; raise that, or use"
        " fewer actor.worlds or a shorter actor.horizon"
    )
