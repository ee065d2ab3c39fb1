"""Actors as jobs of Slurm, by submitit."""

from __future__ import annotations

import json
import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lndrl.errors import UserError
from lndrl.machine.processes import descendants
from lndrl.placement.cluster import Cluster, SlurmActors
from lndrl.wording import counted

if TYPE_CHECKING:
    import submitit


def submit(cluster: Cluster) -> list[str]:
    """Ask Slurm for all jobs of a cluster; their ids, which ``cluster.state`` remembers.

    Raises UserError where there is no Slurm, or it refuses.
    """
    if not cluster.config.slurm:
        return []
    from submitit.core.utils import FailedSubmissionError

    ids: list[str] = []
    for number, part in enumerate(cluster.config.slurm):
        folder = cluster.path.parent / part.folder
        try:
            executor = _executor(part, folder, f"{cluster.config.run}-{number}")
            # One request to Slurm for all: an array.
            with executor.batch():
                jobs = [executor.submit(_command(cluster, part)) for _ in range(part.jobs)]
        except (RuntimeError, OSError, ValueError, FailedSubmissionError) as error:
            cancel(cluster)
            raise UserError(f"slurm, part {number}: {' '.join(str(error).split())[:300]}") from None
        mine = [job.job_id for job in jobs]
        ids += mine
        _remember(cluster.state, part.cluster, str(folder), mine)
    return ids


def cancel(cluster: Cluster) -> list[str]:
    """End all jobs that ``submit`` remembers; a line for each request. Raises UserError."""
    if not cluster.state.exists():
        return []
    import submitit

    try:
        notes = json.loads(cluster.state.read_text("utf-8"))
    except ValueError:
        raise UserError(f"{cluster.state}: is damaged; see squeue, and remove it") from None
    said = []
    for kind, folder, ids in notes:
        for each in ids:
            if kind == "local":
                _end_local(int(each))
            else:
                _scancel(submitit.SlurmJob(folder=folder, job_id=each))
        said.append(f"slurm: {counted(len(ids), 'job')} ended")
    cluster.state.unlink()
    return said


def _executor(part: SlurmActors, folder: Path, name: str) -> submitit.AutoExecutor:
    import submitit

    executor = submitit.AutoExecutor(folder=folder, cluster=part.cluster)
    options: dict[str, Any] = {
        "name": name,
        "cpus_per_task": part.cpus,
        "timeout_min": part.minutes,
        "slurm_array_parallelism": part.jobs,
    }
    if part.partition is not None:
        options["slurm_partition"] = part.partition
    executor.update_parameters(**options)
    return executor


def _command(cluster: Cluster, part: SlurmActors) -> submitit.helpers.CommandFunction:
    import submitit

    words = [part.program, "actor", "--connect", cluster.endpoint(part.site)]
    # A job sees no more cores than it was given, and auto fills these.
    words += ["--count", "auto", "--certs", str(cluster.certificates)]
    return submitit.helpers.CommandFunction(words)


def _remember(file: Path, kind: str, folder: str, ids: list[str]) -> None:
    notes = json.loads(file.read_text("utf-8")) if file.exists() else []
    file.write_text(json.dumps([*notes, [kind, folder, ids]]), encoding="utf-8")


def _scancel(job: submitit.SlurmJob[Any]) -> None:
    try:
        job.cancel(check=False)  # one that has ended long ago is none to complain of
    except OSError as error:
        raise UserError(
            f"slurm: job {job.job_id} cannot be ended from here"
            f" ({error.strerror or error}); scancel it where Slurm is"
        ) from None


def _end_local(pid: int) -> None:
    """End what submitit runs in place of a job: it keeps the process to itself."""
    for each in (*reversed(descendants(pid)), pid):
        with suppress(ProcessLookupError):
            os.kill(each, signal.SIGINT)
