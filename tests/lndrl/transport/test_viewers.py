"""Who is there and what is shown: in memory and over Zenoh on loopback."""

from __future__ import annotations

import dataclasses
import threading
import time

import numpy as np
import pytest

from lndrl.errors import UserError
from lndrl.transport import MessageError
from lndrl.transport.frames import encode_frame
from tests.lndrl.transport.setups import HELLO, PATIENCE, RecordingHandlers, eventually
from tests.lndrl.transport.test_frames import arrays, frame


def test_members_come_and_go(setup):
    setup.learner(handlers := RecordingHandlers())
    actor = setup.actor()
    actor.hello(HELLO, timeout=PATIENCE)
    assert eventually(lambda: ("actor-0", "first", True) in handlers.members)
    actor.close()
    assert eventually(lambda: handlers.members[-1] == ("actor-0", "first", False))


def test_viewers_query_and_stream(setup):
    learner = setup.learner(RecordingHandlers())
    viewer = setup.viewer()
    with pytest.raises(UserError):
        viewer.status(timeout=0.3)
    learner.publish_status(
        {"steps": np.int64(1), "kl": float("nan"), "lag": np.float32("inf")}, [{"rate": 2.5}]
    )
    assert viewer.status(timeout=PATIENCE) == {
        "snapshot": {"steps": 1, "kl": None, "lag": None},
        "history": [{"rate": 2.5}],
    }
    seen = []

    def watch() -> None:
        seen.extend(viewer.stream(silence=0.2))

    thread = threading.Thread(target=watch)
    thread.start()
    assert eventually(lambda: None in seen)
    deadline = time.monotonic() + PATIENCE
    while {"steps": 2} not in seen and time.monotonic() < deadline:
        learner.publish_status({"steps": 2}, [])
        time.sleep(0.05)
    assert {"steps": 2} in seen
    viewer.close()
    thread.join(PATIENCE)
    assert not thread.is_alive()


def test_a_world_is_shown_while_somebody_watches(setup):
    setup.learner(RecordingHandlers())
    actors = [setup.actor() for _ in range(2)]
    for i, actor in enumerate(actors):
        actor.hello(dataclasses.replace(HELLO, actor_id=f"actor-{i}"), timeout=PATIENCE)
    shown, other = actors
    assert not shown.watched(), "nobody asked"
    viewers = [setup.viewer() for _ in range(2)]
    seats = [viewer.watch("actor-0") for viewer in viewers]
    assert eventually(shown.watched)
    assert not other.watched(), "somebody else was asked"
    seen: list[list[int]] = [[], []]

    def both() -> bool:
        shown.show(encode_frame(frame(sequence=len(seen[0]) + len(seen[1])), arrays()))
        for seat, numbers in zip(seats, seen, strict=True):
            if (found := seat.newest()) is not None:
                numbers.append(found[0].sequence)
        return all(len(numbers) >= 2 for numbers in seen)

    assert eventually(both)
    seats[0].close()
    assert not eventually(lambda: not shown.watched(), 0.3), "the other one still watches"
    viewers[1].close()  # as when a terminal is closed
    if setup.kind == "memory":
        seats[1].close()
    assert eventually(lambda: not shown.watched())
    shown.show(b"to nobody, and nothing is raised")
    seats[0].close()


def test_what_is_no_frame_is_said(setup):
    setup.learner(RecordingHandlers())
    actor, viewer = setup.actor(), setup.viewer()
    actor.hello(HELLO, timeout=PATIENCE)
    seat = viewer.watch("actor-0")
    assert eventually(actor.watched)
    actor.show(b"what another version says")

    def refused() -> bool:
        try:
            return seat.newest() is not None
        except (UserError, MessageError) as error:
            assert "magic" in str(error)
            return True

    assert eventually(refused)
    seat.close()
