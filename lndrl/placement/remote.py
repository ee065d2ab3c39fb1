"""One host over ssh: what is installed there, files for it, and processes that outlive the link."""

from __future__ import annotations

import asyncio
import shlex
from pathlib import Path, PurePosixPath

import asyncssh

from lndrl.errors import UserError
from lndrl.placement.cluster import HostConfig, Job
from lndrl.version import VERSION

CONNECT_WITHIN = 15.0
ANSWER_WITHIN = 60.0
"""s that a short command may take; importing a program from a slow disk does."""
NOTES = ".lndrl"
"""Folder on the host, in its ``folder``: certificates, logs and process ids of a run."""


class Host:
    """A connection to ``host``; ``close`` ends it, not what runs there. See ``connected``."""

    def __init__(self, name: str, place: HostConfig, link: asyncssh.SSHClientConnection) -> None:
        self.name, self.place = name, place
        self._link = link

    @classmethod
    async def connected(cls, name: str, place: HostConfig) -> Host:
        """Log in; raises UserError that names the host."""
        options: dict[str, object] = {"login_timeout": CONNECT_WITHIN, "keepalive_interval": 5}
        options |= {
            key: value
            for key, value in (("username", place.user), ("port", place.port))
            if value is not None
        }
        if place.key is not None:
            options["client_keys"] = [str(place.key.expanduser())]
        try:
            link = await asyncio.wait_for(asyncssh.connect(name, **options), CONNECT_WITHIN)
        except (OSError, asyncssh.Error, TimeoutError) as error:
            raise UserError(f"host {name}: {_why(error)}") from None
        return cls(name, place, link)

    async def say(self, command: str, within: float = ANSWER_WITHIN) -> tuple[int, str, str]:
        """Do ``command`` in the host's folder; its exit code, output and errors."""
        line = f"cd {_quoted(self.place.folder)} && {command}"
        try:
            done = await asyncio.wait_for(self._link.run(line, encoding="utf-8"), within)
        except (OSError, asyncssh.Error, TimeoutError) as error:
            raise UserError(f"host {self.name}: {_why(error)}") from None
        code = 255 if done.exit_status is None else done.exit_status
        return code, str(done.stdout or ""), str(done.stderr or "")

    async def check(self) -> None:
        """Raise UserError unless the host has this version of the program."""
        program = _quoted(self.place.program)
        code, out, errors = await self.say(f"{program} --version")
        found = out.strip()
        if code != 0:
            last = (errors.strip().splitlines() or ["no word"])[-1]
            raise UserError(
                f"host {self.name}: {self.place.folder}/{self.place.program} does not start"
                f" ({last}); install lndrl there, or correct folder and program"
            )
        if found != VERSION:
            raise UserError(
                f"host {self.name}: has lndrl {found[:40]}, here is {VERSION}; install the same"
            )

    async def give(self, files: dict[str, Path]) -> None:
        """Copy files into the notes' folder under these names; keys are for their owner alone."""
        parts = sorted({str(PurePosixPath(name).parent) for name in files})
        folders = " ".join(_quoted(f"{NOTES}/{part}") for part in parts)
        await self._must(f"umask 077 && mkdir -p {folders}")
        try:
            async with self._link.start_sftp_client() as sftp:
                for name, file in files.items():
                    to = f"{self.place.folder}/{NOTES}/{name}"
                    mode = 0o600 if name.endswith(".key") else 0o644
                    async with sftp.open(to, "wb", asyncssh.SFTPAttrs(permissions=mode)) as out:
                        await out.write(file.read_bytes())
        except (OSError, asyncssh.Error) as error:
            raise UserError(f"host {self.name}: files cannot be put there ({error})") from None

    async def start(self, job: Job, run: str, words: tuple[str, ...]) -> None:
        """Start a job that goes on without this connection; raises UserError if it runs already."""
        if await self.alive(job, run):
            raise UserError(
                f"host {self.name}: {job.name} of run {run} runs there already; lndrl down ends it"
            )
        note = f"{NOTES}/{run}/{job.name}"
        command = " ".join(map(_quoted, (self.place.program, *words)))
        threads = "" if job.role == "learner" else "OMP_NUM_THREADS=1 "
        # A session of its own: nothing that ends this connection ends it.
        await self._must(
            f"mkdir -p {_quoted(f'{NOTES}/{run}')} && {{ {threads}setsid nohup {command}"
            f" > {_quoted(note + '.log')} 2>&1 < /dev/null & echo $! > {_quoted(note + '.pid')}; }}"
        )

    async def alive(self, job: Job, run: str) -> bool:
        """Whether the job's process runs."""
        code, _, _ = await self.say(_find(f"{NOTES}/{run}/{job.name}") + " && kill -0 $p")
        return code == 0

    async def log(self, job: Job, run: str, lines: int = 20) -> list[str]:
        """The last lines of what the job said."""
        note = _quoted(f"{NOTES}/{run}/{job.name}.log")
        _, out, _ = await self.say(f"tail -n {lines} {note} 2>/dev/null || true")
        return out.splitlines()

    async def signal(self, job: Job, run: str, number: str) -> None:
        """Send a signal to the job; to all that it started with it where it is KILL."""
        target = "-$p" if number == "KILL" else "$p"  # it leads a session, and so a group
        await self.say(
            _find(f"{NOTES}/{run}/{job.name}") + f" && kill -{number} -- {target} || true"
        )

    async def exists(self, path: str) -> bool:
        """Whether there is such a file or folder, from the host's folder on."""
        return (await self.say(f"test -e {_quoted(path)}"))[0] == 0

    def close(self) -> None:
        """Leave."""
        self._link.close()

    async def _must(self, command: str) -> None:
        code, _, errors = await self.say(command)
        if code != 0:
            last = (errors.strip().splitlines() or ["no word"])[-1]
            raise UserError(f"host {self.name}: {last}")


def _find(note: str) -> str:
    """Shell that sets ``p`` to the noted process, if that still is one of this program.

    A number may belong to another program by now, after the machine has started anew.
    """
    file = _quoted(note + ".pid")
    return f"p=$(cat {file} 2>/dev/null) && tr '\\0' ' ' < /proc/$p/cmdline | grep -q lndrl"


def _quoted(word: str) -> str:
    """For the shell there; a leading ~ stays what it means."""
    if word.startswith("~/"):
        return "~/" + shlex.quote(word[2:])
    return shlex.quote(word)


def _why(error: Exception) -> str:
    """What went wrong with a connection, and what to try."""
    if isinstance(error, TimeoutError | asyncio.TimeoutError):
        return "no answer in time; is it on, and does a firewall let ssh through?"
    if isinstance(error, asyncssh.HostKeyNotVerifiable):
        return "its key is not known here; log in once with ssh, and compare it"
    if isinstance(error, asyncssh.PermissionDenied):
        return "ssh lets nobody in with the keys at hand; try ssh itself, or name user and key"
    if isinstance(error, asyncssh.Error):
        return f"the ssh connection failed ({error.reason})"
    return f"cannot be reached by ssh ({getattr(error, 'strerror', None) or error})"
