"""Start everything that a cluster file names, watch it, and end it together."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from threading import Event
from typing import Any, TypeVar

from lndrl.errors import UserError
from lndrl.placement import slurm
from lndrl.placement.cluster import Cluster, Job, PlaceConfig
from lndrl.placement.remote import NOTES, Host
from lndrl.transport.security.certificates import create, host_names, load_certificate
from lndrl.wording import counted

Say = Callable[[str], None]
T = TypeVar("T")

LISTENS_WITHIN = 300.0
"""s until the learner or a site listens: it may have to import much from a slow disk."""
_LISTENS = {"learner": "[listen]", "site": "actors of this site"}
"""How the line begins by which each of those says that it listens."""
LEAVE_WITHIN = {"learner": 120.0, "site": 15.0, "actor": 15.0, "evaluator": 15.0}
"""s that each role may take for an orderly end: a learner writes a checkpoint."""
_LOOK = 1.0  # s
_AWAY = 60.0  # s that a host may be out of reach before that is said again


def up(cluster: Cluster, detach: bool, stop: Event, say: Say) -> int:
    """Start everything and watch it until the run is done or ``stop`` is set; the exit code.

    With ``detach`` returns once all run. Whatever is raised, UserError for what the user can mend,
    what had been started is ended again.
    """
    return asyncio.run(_Launch(cluster, say).up(detach, stop))


def down(cluster: Cluster, say: Say) -> None:
    """End everything that ``up`` has started, the learner last; raises UserError."""
    asyncio.run(_Launch(cluster, say).down())


class _Launch:
    """All hosts of a cluster, each with one connection."""

    def __init__(self, cluster: Cluster, say: Say) -> None:
        self._cluster, self._say = cluster, say
        self._run = cluster.config.run
        self._hosts: dict[tuple[str, str | None, int | None, str], Host] = {}
        self._started: list[Job] = []
        self._slurm: list[str] = []
        self._asks_slurm = False  # its jobs are this command's to end

    async def up(self, detach: bool, stop: Event) -> int:
        configuration = self._cluster.configuration
        check_certificates(self._cluster, self._say)
        jobs = list(self._cluster.others())
        name = f"{self._run}/{configuration.name}"
        try:
            _raise(await self._reach([self._cluster.learner("", False), *jobs]))
            await self._together([host.check() for host in self._hosts.values()])
            place = self._cluster.config.learner
            resume = await self._host(place.host, place).exists(f"runs/{self._run}")
            learner = self._cluster.learner(f"{NOTES}/{name}", resume)
            await self._hand_out([learner, *jobs])
            await self._host(learner.host, place).give({name: configuration})
            await self._start(learner)
            await self._listening(learner, stop)
            # Whoever connects finds a door that is open: an actor does not wait long for its first.
            doors = [job for job in jobs if job.role == "site"]
            for job in doors:
                await self._start(job)
            for job in doors:
                await self._listening(job, stop)
            for job in jobs:
                if job not in doors:
                    await self._start(job)
            self._asks_slurm = True
            self._slurm = slurm.submit(self._cluster)
            self._say(f"everything runs: {self._words(jobs)}; lndrl down ends it")
            if detach:
                return 0
            return await self._watch(learner, jobs, stop)
        except BaseException:
            await self._end(self._started)
            raise
        finally:
            self._close()

    async def down(self) -> None:
        jobs = [self._cluster.learner("", True), *self._cluster.others()]
        try:
            away = await self._reach(jobs)
            self._asks_slurm = True
            # A host that is off keeps nobody else running.
            await self._end([job for job in jobs if _key(job.host, job.place) in self._hosts])
        finally:
            self._close()
        if away:
            _raise([*away, UserError("what was started there may run on; all else has ended")])

    # -- steps -------------------------------------------------------------------------------

    async def _reach(self, jobs: Sequence[Job]) -> list[UserError]:
        """Log in everywhere; why it failed where it did."""
        places = {_key(job.host, job.place): (job.host, job.place) for job in jobs}
        logins = (Host.connected(*each) for each in places.values())
        found = await asyncio.gather(*logins, return_exceptions=True)
        failed = [each for each in found if isinstance(each, BaseException)]
        pairs = zip(places, found, strict=True)
        self._hosts = {key: host for key, host in pairs if not isinstance(host, BaseException)}
        _raise([each for each in failed if not isinstance(each, UserError)])
        return [each for each in failed if isinstance(each, UserError)]

    async def _hand_out(self, jobs: Sequence[Job]) -> None:
        """Each host gets the certificates of the roles that it plays."""
        folder = self._cluster.certificates
        wanted: dict[Host, set[str]] = {}
        for job in jobs:
            wanted.setdefault(self._host(job.host, job.place), set()).add(job.role)
        await self._together(
            [
                host.give(
                    {
                        f"{self._run}/certs/{name}": folder / name
                        for role in sorted(roles)
                        for name in ("ca.pem", f"{role}.pem", f"{role}.key")
                    }
                )
                for host, roles in wanted.items()
            ]
        )

    async def _start(self, job: Job) -> None:
        words = (*job.words, "--certs", f"{NOTES}/{self._run}/certs")
        host = self._host(job.host, job.place)
        await host.start(job, self._run, words)
        self._started.append(job)
        self._say(f"host {job.host}: {job.name} started")

    async def _listening(self, job: Job, stop: Event) -> None:
        """Wait until others can connect to a learner or site; raises UserError with its words."""
        host, deadline = self._host(job.host, job.place), time.monotonic() + LISTENS_WITHIN
        name = "the learner" if job.role == "learner" else job.name
        while not stop.is_set():
            lines = await host.log(job, self._run)
            if any(line.startswith(_LISTENS[job.role]) for line in lines):
                return
            if not await host.alive(job, self._run):
                last = (await host.log(job, self._run) or ["no word"])[-1]
                raise UserError(f"host {job.host}: {name} ended at once: {last}")
            if time.monotonic() > deadline:
                raise UserError(
                    f"host {job.host}: {name} does not listen after {LISTENS_WITHIN:g} s"
                )
            await asyncio.sleep(_LOOK)
        raise KeyboardInterrupt

    async def _watch(self, learner: Job, jobs: Sequence[Job], stop: Event) -> int:
        """Until the learner ends or ``stop``; what else ends or is out of reach is said."""
        gone: set[str] = set()
        away: dict[str, float] = {}
        while not stop.is_set():
            for job in (learner, *jobs):
                alive = await self._look(job, away)
                if alive is not False or job.name in gone:
                    continue
                gone.add(job.name)
                last = (await self._host(job.host, job.place).log(job, self._run) or ["no word"])[
                    -1
                ]
                if job is learner:
                    self._say(f"host {job.host}: the learner has ended: {last}")
                    await self._end(jobs)
                    return 0 if "finished" in last or "next: lndrl evaluate" in last else 1
                self._say(f"host {job.host}: {job.name} has ended: {last}")
            await asyncio.sleep(_LOOK)
        await self._end([learner, *jobs])
        return 0

    async def _look(self, job: Job, away: dict[str, float]) -> bool | None:
        """Whether a job runs; None while its host is out of reach."""
        key = _key(job.host, job.place)
        try:
            alive = await self._hosts[key].alive(job, self._run)
        except UserError as error:
            if time.monotonic() - away.get(job.host, float("-inf")) > _AWAY:
                away[job.host] = time.monotonic()
                self._say(f"{error}; what runs there goes on by itself")
            try:
                self._hosts[key] = await Host.connected(job.host, job.place)
            except UserError:
                return None
            return None
        if away.pop(job.host, None) is not None:
            self._say(f"host {job.host}: can be reached again")
        return alive

    async def _end(self, jobs: Sequence[Job]) -> None:
        """Ask everybody to leave, the learner last, and end whoever stays."""
        try:
            for line in slurm.cancel(self._cluster) if self._asks_slurm else []:
                self._say(line)
        except UserError as error:  # what runs elsewhere ends all the same
            self._say(f"{error}; jobs of Slurm may still run")
        learners = [job for job in jobs if job.role == "learner"]
        for group in ([job for job in jobs if job.role != "learner"], learners):
            outcomes = await asyncio.gather(*map(self._end_one, group), return_exceptions=True)
            for job, outcome in zip(group, outcomes, strict=True):
                if isinstance(outcome, UserError):
                    self._say(f"{outcome}; {job.name} may still run there")
                elif isinstance(outcome, BaseException):
                    raise outcome
                elif outcome:
                    self._say(f"host {job.host}: {outcome}")

    async def _end_one(self, job: Job) -> str:
        host = self._host(job.host, job.place)
        if not await host.alive(job, self._run):
            return ""
        await host.signal(job, self._run, "INT")
        deadline = time.monotonic() + LEAVE_WITHIN[job.role]
        while await host.alive(job, self._run):
            if time.monotonic() > deadline:
                await host.signal(job, self._run, "KILL")
                return f"{job.name} did not end when asked, and was ended"
            await asyncio.sleep(0.2)
        return f"{job.name} ended"

    # -- small steps -------------------------------------------------------------------------

    def _host(self, name: str, place: PlaceConfig) -> Host:
        return self._hosts[_key(name, place)]

    async def _together(self, work: Sequence[Coroutine[Any, Any, T]]) -> list[T]:
        """All at once; when all have ended, one error that says what went wrong with any."""
        done = await asyncio.gather(*work, return_exceptions=True)
        _raise([each for each in done if isinstance(each, BaseException)])
        return [each for each in done if not isinstance(each, BaseException)]

    def _close(self) -> None:
        for host in self._hosts.values():
            host.close()

    def _words(self, jobs: Sequence[Job]) -> str:
        hosts = len({job.host for job in (*jobs, *self._started)})
        placed = f", {counted(len(self._slurm), 'job')} of Slurm" if self._slurm else ""
        return f"{counted(len(jobs) + 1, 'process group')} on {counted(hosts, 'host')}{placed}"


def check_certificates(cluster: Cluster, say: Say) -> None:
    """Make certificates where there are none; raises UserError where one lacks, or a name in it."""
    folder = cluster.certificates
    address, sites = cluster.learner_address(), cluster.site_addresses()
    if not folder.exists():
        create(folder, [address], site_hosts=sites)
        say(f"{folder}: new certificates; ca.key stays here")
        return
    if not (folder / "ca.pem").exists():
        raise UserError(
            f"{folder}: has no ca.pem; name a folder that lndrl certs has made, or one that is not"
            " there yet"
        )
    names = {"learner": [address], "site": sites}
    for role in sorted({"learner", "actor", *(job.role for job in cluster.others())}):
        wanted = names.get(role, [])
        option = "".join(f" {each}" for each in wanted)
        option = option and (" --site-host" if role == "site" else " --host") + option
        renew = f"lndrl certs --out {folder} --renew {role}{option}"
        for file in (folder / f"{role}.pem", folder / f"{role}.key"):
            if not file.exists():
                raise UserError(f"{folder}: has no {file.name}; {renew} makes one")
        if not wanted:
            continue
        file = folder / f"{role}.pem"
        lacking = [each for each in wanted if each not in host_names(load_certificate(file))]
        if lacking:
            raise UserError(f"{file}: is not made for {', '.join(lacking)}; {renew}")


def _raise(failures: Sequence[BaseException]) -> None:
    """Raise what has failed, if anything has: all that a user can mend in one sentence."""
    for each in failures:
        if not isinstance(each, UserError):
            raise each
    if failures:
        raise UserError("; ".join(dict.fromkeys(map(str, failures))))


def _key(name: str, place: PlaceConfig) -> tuple[str, str | None, int | None, str]:
    return name, place.user, place.port, f"{place.folder} {place.program} {_path(place.key)}"


def _path(key: Path | None) -> str:
    return "" if key is None else str(key)
