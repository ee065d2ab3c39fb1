from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.lndrl.transport.setups import Setup


@pytest.fixture(params=["memory", "zenoh"])
def setup(request) -> Iterator[Setup]:
    made = Setup(request.param)
    yield made
    for endpoint in reversed(made.open):
        endpoint.close()
