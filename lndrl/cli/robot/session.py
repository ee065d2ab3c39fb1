"""One drive from the command line: what is said before it, the drive itself, what it came to."""

from __future__ import annotations

import json as json_format
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from lndrl.cli.again import arguments_given
from lndrl.cli.help import say_next
from lndrl.cli.signals import LastResort, last_resort, say, stop_on_signals

if TYPE_CHECKING:
    from lndrl.planners import PlannerSource
    from lndrl.robot.driving import DriveService, Limits
    from lndrl.robot.driving.assembly import DriveOptions
    from lndrl.robot.link import Address
    from lndrl.robot.recording import Recorder

_STAYS = 0.5
"""s for which a robot at its only goal is told to stop, before the program leaves."""
_ENDS_WITHIN = 20.0
"""s that an orderly end may take: last stops, the session, the recording."""


class DriveSession:
    """A drive of ``source``; raises UserError for a filter that no robot has.

    ``record``: where to; ``seconds``: for how long at most.
    """

    def __init__(
        self,
        source: PlannerSource,
        options: DriveOptions,
        address: Address,
        record: Path | None,
        seconds: float | None,
    ) -> None:
        from lndrl.evaluation import settings_for
        from lndrl.robot.driving.assembly import drive_config
        from lndrl.robot.shapes import planned_for

        self._source, self._options, self._address = source, options, address
        self._record, self._seconds = record, seconds
        config = settings_for(source)
        if options.robot is not None and source.weights is None:
            config = planned_for(options.robot, config)  # rules plan with what they are told
        self._config = drive_config(config, options)
        self._differences: list[str] = []

    def note(self, named: str | None, asked: Limits) -> None:
        """Say in what the robot is not what the policy was trained for, and what the guard goes by.

        ``named`` is ``--robot``; ``asked`` are the limits that were given beside it.
        """
        from lndrl.navigation import action_table
        from lndrl.robot.fitting import UNKNOWN, guard_words, guarded_base
        from lndrl.robot.shapes import differences

        options, shape = self._options, self._options.robot
        fastest = np.abs(action_table(self._config.task)).max(axis=0)
        notes = asked.notes((float(fastest[0]), float(fastest[1])))
        if shape is not None:
            self._differences = differences(shape, self._config)
            say(f"robot {named}: {shape.description or 'as its file says'}")
        for words in [*self._differences, *notes]:
            say(f"note: {words}")
        if options.guard is None:
            say("guard: off; nothing but the policy keeps the robot from people and walls")
            return
        radius = float(self._config.world.robot_radius) if shape is None else shape.reach
        if shape is None:
            say(f"note: nobody says which robot it is (--robot); the guard takes the {UNKNOWN} one")
        say(f"guard: on; {guard_words(options.guard, guarded_base(shape, radius))}")

    def run(self, plain: bool, json: bool) -> None:
        """Drive, and say what it came to. Raises typer.Exit where a signal has ended it."""
        from lndrl.cli.robot.live import screen
        from lndrl.policy.acting import act_on_one_thread
        from lndrl.robot.driving.assembly import make_pilot, make_service
        from lndrl.robot.link import open_link
        from lndrl.robot.messages import MessageStore
        from lndrl.robot.recording import Recorder
        from lndrl.view.progress import StatusLine

        source, options, endpoint = self._source, self._options, self._address.endpoint
        MessageStore("jazzy")  # says what is not installed, before anything takes time
        with StatusLine() as line:
            line.update(f"loading {source.title}")
            if source.weights is not None:
                act_on_one_thread(self._config)
            pilot = make_pilot(source, self._config, options)
            line.update(f"connecting to {endpoint}")
            link = open_link(self._address, "lndrl_drive")
        with (
            last_resort(_ENDS_WITHIN) as resort,
            ExitStack() as open_,
            stop_on_signals("the robot is told to stop") as stop,
            link,
        ):
            recorder = None
            if self._record is not None:
                recorder = open_.enter_context(Recorder(self._record, link.store))
            service = make_service(link, pilot, options, recorder)
            over = _over(service, options.goal is not None, self._seconds, resort)
            head = f"{source.title} drives {endpoint} ({link.dialect.name})"
            with screen(head, service, plain or json) as show:
                service.run(stop, show, over)
            exit_code = stop.exit_code
        self._say_result(service, recorder, json)
        if exit_code:
            raise typer.Exit(exit_code)

    def _say_result(self, service: DriveService, recorder: Recorder | None, json: bool) -> None:
        tally, latencies = service.driver.tally, np.array(service.latencies)
        content: dict[str, Any] = {
            "arrivals": tally.arrivals,
            "decisions": tally.decisions,
            "distance": tally.distance,
            "stops": tally.stops,
            "guard": service.driver.guard is not None,
            "guarded": tally.guarded / max(tally.decisions, 1),
            "differences": self._differences,
        }
        if len(latencies):
            median, worst = np.percentile(latencies, [50, 99]) * 1000.0
            content["latency_milliseconds"] = {"median": median, "p99": worst}
        if recorder is not None:
            content["recorded_messages"] = recorder.messages
        if json:
            typer.echo(json_format.dumps(content, indent=2))
            return
        stops = ", ".join(f"{name} {count}" for name, count in tally.stops.items())
        held = f"{100.0 * content['guarded']:.0f} % held back by the guard"
        typer.echo(
            f"{tally.arrivals} arrived, {tally.distance:.1f} m, {tally.decisions} decisions"
            + (f", {held}" if content["guard"] else ", no guard")
            + (f", scan to command {median:.1f} ms, p99 {worst:.1f} ms" if len(latencies) else "")
            + (f"; stopped by {stops}" if stops else "")
        )
        if recorder is None:
            say_next(
                "lndrl", *arguments_given(), "--record", "drive.mcap", then="keeps what is heard"
            )
            return
        typer.echo(recorder.failed or f"{recorder.messages:,} messages recorded")
        say_next("lndrl", "replay", self._record, then="where its belief went")


def _over(
    service: DriveService, single: bool, seconds: float | None, resort: LastResort
) -> Callable[[], bool]:
    """Whether to leave: the time is over, or the only goal reached, and the robot told so.

    From then on ``resort`` counts.
    """
    began = time.monotonic()
    arrived: list[float] = []

    def over() -> bool:
        if reached(time.monotonic()):
            resort.arm()
            return True
        return False

    def reached(now: float) -> bool:
        if seconds is not None and now - began >= seconds:
            return True
        if single and service.driver.arrived:
            arrived.append(now)
            return now - arrived[0] >= _STAYS
        arrived.clear()
        return False

    return over
