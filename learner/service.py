"""The learner as a service: endpoint, learner and status put together."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from threading import Event

from learner.intake.lanes import lane_of
from learner.learner import Learner
from learner.ppo.team import Team
from learner.ranks.crew import Crew
from learner.run.record import RunSummary, quiet_tensorboard
from learner.status import StatusThread
from learner.watchers import Watchers
from lndrl import kernels
from lndrl.ahead import compiling_ahead
from lndrl.config import RunConfig
from lndrl.machine.files import raise_file_limit
from lndrl.transport import Security, open_learner

_GOODBYE = 5.0  # s for actors to hear that the run is done


def run_learner(
    config: RunConfig,
    path: Path,
    resume: bool,
    endpoint: str | None = None,
    stop: Event | None = None,
    checkpoint: str | None = None,
    quiet: bool = False,
    on_ready: Callable[[Learner], None] = lambda learner: None,
    security: Security | None = None,
    team: Team | None = None,
    metrics: tuple[str, int] | None = None,
    trackers: Sequence[str] = (),
) -> RunSummary:
    """Serve one training run until it is finished or ``stop`` is set; returns its summary.

    ``on_ready`` is called once actors can connect. ``team``: this is its rank 0, and the others
    follow (``learner.ranks.follower``). ``metrics``: address and port for Prometheus;
    ``trackers``: where figures go beside, see ``Watchers``.
    Ports are taken before the folder is made, so a busy one leaves nothing behind. Raises
    UserError for whatever the user can mend.
    """
    stop = stop or Event()
    if endpoint is not None:
        transport = config.transport.model_copy(update={"endpoint": endpoint})
        config = config.model_copy(update={"transport": transport})
    quiet_tensorboard()
    raise_file_limit()
    lane = "" if team is None else lane_of(team.rank)
    door = open_learner(config.transport, security=security, lane=lane)
    crew, well = None if team is None else Crew(team), False
    watchers = Watchers(trackers)
    try:
        watchers.listen(metrics)
        learner = Learner(config, path, door, resume, checkpoint, quiet, crew)
        learner.events.add("listen", config.transport.endpoint)
        if team is not None:
            learner.events.add("ranks", f"{team.size}, on {', '.join(dict.fromkeys(team.hosts))}")
        status = StatusThread(learner)
        status.start()
        watchers.begin(learner, status)
        on_ready(learner)
        try:
            with (
                kernels.told(kernels.Lines(lambda text: learner.events.add("start", text))),
                compiling_ahead(config),
            ):
                learner.run(stop)
        finally:
            status.stop()
            watchers.end()
            learner.close()
        _wait_for_goodbyes(learner)
        well = True
        return learner.summary()
    finally:
        watchers.close()
        if crew is not None:
            crew.leave(well)
        door.close()


def _wait_for_goodbyes(learner: Learner) -> None:
    deadline = time.monotonic() + (_GOODBYE if learner.finished else 0.0)
    while time.monotonic() < deadline and learner.roster.counts()[0]:
        time.sleep(0.1)
