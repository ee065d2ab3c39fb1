"""The processes of a sweep: ``lndrl train`` and ``lndrl evaluate``, as users start them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import lndrl
from lndrl.evaluation.sweep.folder import SweepFolder
from lndrl.evaluation.sweep.runs import Job


class Launcher:
    """Starts the jobs of a sweep in ``folder``, ``parallel`` of them side by side.

    ``lock`` is the descriptor that ``folder.locked`` yields.
    """

    def __init__(self, folder: SweepFolder, lock: int, parallel: int = 1) -> None:
        self.folder, self.lock = folder, lock
        self.workers = max(1, len(os.sched_getaffinity(0)) // parallel)
        self.environment = this_program()

    def __call__(self, job: Job) -> RealProcess:
        """Start ``job``; what it says goes to its run's log."""
        log = self.folder.log_path(job.run)
        log.parent.mkdir(parents=True, exist_ok=True)
        if job.kind == "evaluate":
            result = self.folder.evaluation_path(job.run)
            partial = result.with_suffix(".partial")
            process = self._start(self._evaluation(job), partial, log)
            return RealProcess(process, partial, result)
        return RealProcess(self._start(self._training(job), log, log))

    def _training(self, job: Job) -> list[str]:
        command = ["train"]
        if job.kind == "train":
            command.append(str(self.folder.prepare(job.run)))
        command += ["--run", job.run.name]
        if job.kind == "resume":
            command.append("--resume")
        if self.folder.sweep.spec.serial:
            return [*command, "--serial"]
        return [*command, "--no-dashboard", "--listen", f"tcp/127.0.0.1:{free_port()}"]

    def _evaluation(self, job: Job) -> list[str]:
        spec = self.folder.sweep.spec
        command = ["evaluate", str(self.folder.run_path(job.run)), "--json"]
        command += ["--episodes", str(spec.episodes), "--workers", str(self.workers)]
        return [*command, "--greedy"] if spec.greedy else command

    def _start(self, command: list[str], out: Path, log: Path) -> subprocess.Popen[bytes]:
        with out.open("ab" if out == log else "wb") as stdout, log.open("ab") as stderr:
            return subprocess.Popen(
                [sys.executable, "-m", "lndrl", *command],
                cwd=self.folder.path,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                pass_fds=(self.lock,),
                # Ctrl-C in a terminal would reach it twice: from there and from the sweep.
                start_new_session=True,
            )


class RealProcess:
    """A job's process and its descendants; ``partial`` becomes ``result`` when it succeeds."""

    def __init__(
        self,
        process: subprocess.Popen[bytes],
        partial: Path | None = None,
        result: Path | None = None,
    ) -> None:
        self.process = process
        self._partial, self._result = partial, result
        self._interrupted = False

    def poll(self) -> int | None:
        """Exit code, None while it works."""
        code = self.process.poll()
        if code == 0 and self._partial and self._result and self._partial.exists():
            self._partial.replace(self._result)
        return code

    def interrupt(self) -> None:
        """SIGINT, once: a second one would cost the checkpoint."""
        if not self._interrupted and self.process.poll() is None:
            self._interrupted = True
            self.process.send_signal(signal.SIGINT)

    def end(self, grace: float) -> None:
        """Wait ``grace`` s for the orderly end, then end the whole session."""
        self.interrupt()
        try:
            self.process.wait(grace)
        except (subprocess.TimeoutExpired, KeyboardInterrupt):
            with suppress(ProcessLookupError):
                os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()


def this_program() -> dict[str, str]:
    """The environment in which ``python -m lndrl`` is the program that runs now.

    Whatever else is installed: a child's working folder is another.
    """
    here = str(Path(lndrl.__file__).resolve().parents[1])
    inherited = os.environ.get("PYTHONPATH")
    path = os.pathsep.join([here, inherited] if inherited else [here])
    return os.environ | {"PYTHONPATH": path}


def free_port() -> int:
    """A TCP port of the loopback interface that nobody listens on."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])
