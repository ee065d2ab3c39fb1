"""The processes of runs: ``lndrl train`` and ``lndrl evaluate``, as users start them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from lndrl.evaluation.sweep.folder import Run, RunsFolder, SweepFolder
from lndrl.evaluation.sweep.runs import Job
from lndrl.extensions import PARTS_FOLDER, parts_folder, trusted_modules
from lndrl.machine.cores import THREAD_VARIABLES, usable_cores
from lndrl.machine.ports import free_port


class Trainer:
    """Starts ``lndrl train`` for runs of ``folder``; ``options`` says what else it is given.

    ``lock`` is the descriptor that ``folder.locked`` yields.
    """

    def __init__(self, folder: RunsFolder, lock: int, options: Callable[[Run], list[str]]) -> None:
        self.lock, self.options = lock, options
        self.environment = this_program()
        self._runs = folder

    def __call__(self, job: Job) -> RealProcess:
        """Start ``job``; what it says goes to its run's log."""
        log = self._log(job)
        command = ["train"]
        if job.kind == "train":
            command.append(str(self._runs.prepare(job.run)))
        command += ["--run", job.run.name]
        if job.kind == "resume":
            command.append("--resume")
        return RealProcess(self._start([*command, *self.options(job.run)], log, log))

    def _log(self, job: Job) -> Path:
        log = self._runs.log_path(job.run)
        log.parent.mkdir(parents=True, exist_ok=True)
        return log

    def _start(self, command: list[str], out: Path, log: Path) -> subprocess.Popen[bytes]:
        with out.open("ab" if out == log else "wb") as stdout, log.open("ab") as stderr:
            return subprocess.Popen(
                [sys.executable, "-m", "lndrl", *command, *trust_options()],
                cwd=self._runs.path,
                env=self.environment,
                stdin=subprocess.DEVNULL,
                stdout=stdout,
                stderr=stderr,
                pass_fds=(self.lock,),
                # Ctrl-C in a terminal would reach it twice: from there and from who started it.
                start_new_session=True,
            )


class Launcher(Trainer):
    """Starts the jobs of a sweep in ``folder``, ``parallel`` of them side by side."""

    def __init__(self, folder: SweepFolder, lock: int, parallel: int = 1) -> None:
        super().__init__(folder, lock, self._training)
        self.folder = folder
        self.workers = max(1, usable_cores() // parallel)
        if parallel > 1:
            # Each would start threads for all cores, and these wait for each other spinning: two
            # serial runs on two cores then take five times as long.
            share = dict.fromkeys(THREAD_VARIABLES, str(self.workers))
            self.environment = share | self.environment  # what the user has set stays

    def __call__(self, job: Job) -> RealProcess:
        """See ``Trainer``."""
        if job.kind != "evaluate":
            return super().__call__(job)
        result = self.folder.evaluation_path(job.run)
        partial = result.with_suffix(".partial")
        process = self._start(self._evaluation(job), partial, self._log(job))
        return RealProcess(process, partial, result)

    def _training(self, run: Run) -> list[str]:
        if self.folder.sweep.spec.serial:
            return ["--serial"]
        return ["--no-dashboard", "--listen", f"tcp/127.0.0.1:{free_port()}"]

    def _evaluation(self, job: Job) -> list[str]:
        spec = self.folder.sweep.spec
        command = ["evaluate", str(self.folder.run_path(job.run)), "--json"]
        command += ["--episodes", str(spec.episodes), "--workers", str(self.workers)]
        command += ["--checkpoint", "newest"]
        return [*command, "--greedy"] if spec.greedy else command


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


def trust_options() -> list[str]:
    """The options by which a child imports own parts from where this process does."""
    return [part for name in trusted_modules() for part in ("--trust-modules", name)]


def this_program() -> dict[str, str]:
    """The environment in which ``python -m lndrl`` is the program that runs now.

    Whatever else is installed, and whatever lies in the child's working folder, which is another.
    Where this process trusts modules, the child finds those of this working folder, too.
    """
    here = str(Path(__file__).resolve().parents[3])
    inherited = os.environ.get("PYTHONPATH")
    folders = [here, *([inherited] if inherited else [])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders), "PYTHONSAFEPATH": "1"}
    # Not in PYTHONPATH, which comes before Python's own modules: a random.py beside the user's
    # parts would stand in for them, and a sitecustomize.py would run unasked.
    return environment | ({PARTS_FOLDER: parts_folder()} if trusted_modules() else {})
