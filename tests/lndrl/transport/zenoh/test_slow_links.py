"""Weights over links that take nothing in: nobody else may have to wait for them."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing

from lndrl.chaos.proxy import Proxy
from lndrl.config import TransportConfig
from lndrl.transport import Hello, Refusal, Welcome, free_endpoint, open_actor, open_learner

BLOB = bytes(40_000_000)
STALLED = 3


class Handlers:
    def on_hello(self, hello: Hello) -> Welcome | Refusal:
        return Welcome("run", {}, 0)

    def on_chunk(self, header, arrays, size):
        raise AssertionError

    def on_malformed(self, reason: str) -> None:
        raise AssertionError

    def on_member(self, actor_id: str, incarnation: str, alive: bool) -> None:
        pass


def test_weights_that_are_long_on_their_way_pass_in_one_go() -> None:
    config = TransportConfig(endpoint=free_endpoint(), lease=60.0)
    port = int(config.endpoint.rpartition(":")[2])
    with ExitStack() as stack:
        learner = stack.enter_context(closing(open_learner(config)))
        learner.start(Handlers())
        learner.publish_weights(1, BLOB)
        proxy = stack.enter_context(closing(Proxy(("127.0.0.1", port))))
        actor = stack.enter_context(closing(open_actor(proxy.endpoint, config)))
        actor.hello(Hello("actor-0", "life", "here", 1, 8, "0.1"), 60.0)
        with ThreadPoolExecutor(1) as pool:
            fetched = pool.submit(actor.fetch, None, 120.0)
            while proxy.forwarded < 10**6:
                time.sleep(0.005)
            proxy.stall()  # zenoh by itself closes a link on which nothing leaves for 5 s
            time.sleep(6.5)
            proxy.mend()
            assert fetched.result(60.0) == (1, BLOB)
        assert proxy.connections == 1 and proxy.forwarded < 1.2 * len(BLOB)


def test_links_that_stall_keep_no_other_actor_from_its_weights() -> None:
    config = TransportConfig(endpoint=free_endpoint(), lease=60.0)
    port = int(config.endpoint.rpartition(":")[2])
    with ExitStack() as stack:
        learner = stack.enter_context(closing(open_learner(config)))
        learner.start(Handlers())
        learner.publish_weights(1, BLOB)
        proxies = [stack.enter_context(closing(Proxy(("127.0.0.1", port)))) for _ in range(STALLED)]
        slow = [stack.enter_context(closing(open_actor(p.endpoint, config))) for p in proxies]
        quick = stack.enter_context(closing(open_actor(config.endpoint, config)))
        for number, actor in enumerate([*slow, quick]):
            actor.hello(Hello(f"actor-{number}", "life", "here", 1, 8, "0.1"))
        with ThreadPoolExecutor(STALLED) as pool:
            before = [proxy.forwarded for proxy in proxies]
            fetched = [pool.submit(actor.fetch, None, 60.0) for actor in slow]
            deadline = time.monotonic() + 30.0
            while any(p.forwarded < b + 10**6 for p, b in zip(proxies, before, strict=True)):
                assert time.monotonic() < deadline
                time.sleep(0.005)
            for proxy in proxies:
                proxy.stall()
            # Each of them would hold a single answering thread for 5 s, until its link is given up.
            began = time.monotonic()
            assert quick.fetch(None, 60.0)[0] == 1
            waited = time.monotonic() - began
            for proxy in proxies:
                proxy.mend()
            assert [found.result(60.0)[0] for found in fetched] == [1] * STALLED
    assert waited < 4.5, waited
