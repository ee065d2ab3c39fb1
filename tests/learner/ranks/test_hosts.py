"""Two ranks on two hosts, in network namespaces, where a host's own name is of no use."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml

from lndrl.chaos.hosts import Hosts, missing
from lndrl.chaos.stage import CONFIG
from lndrl.evaluation.sweep.processes import this_program

PATIENCE = 300.0  # s, for machines with much else to do
WHY_NOT = missing()


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT or "there are hosts")
def test_ranks_on_two_hosts_find_each_other_and_end_in_order(tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(yaml.safe_dump(CONFIG))
    job = {"WORLD_SIZE": "2", "MASTER_ADDR": "192.0.2.1", "MASTER_PORT": "29400"}
    # Ranks that other tests made in this process may have left where gloo is to look.
    free = {k: v for k, v in this_program().items() if k != "GLOO_SOCKET_IFNAME"}
    words = "-m learner small.yaml --run-name far --listen tcp/0.0.0.0:7447 --insecure".split()
    logs = [tmp_path / f"{rank}.log" for rank in range(2)]
    with Hosts() as hosts:
        hosts.add("host-0")
        hosts.add("host-1")
        hosts.join("host-0", "192.0.2.1/24", "host-1", "192.0.2.2/24")
        ranks: list[subprocess.Popen[bytes]] = []
        for rank, log in enumerate(logs):
            named = f'hostname host-{rank} && exec "$@"'
            command = ["unshare", "--uts", "sh", "-c", named, "sh", sys.executable, *words]
            more = {**job, "RANK": str(rank), "OMP_NUM_THREADS": "1"}
            with log.open("wb") as file:
                ranks.append(
                    hosts.start(
                        f"host-{rank}",
                        command,
                        cwd=tmp_path,
                        env=free | more,
                        stdin=subprocess.DEVNULL,
                        stdout=file,
                        stderr=file,
                    )
                )
        try:
            deadline = time.monotonic() + PATIENCE
            # Stopped or not, the other joins rank 0's port before either ends.
            while "[listen]" not in logs[0].read_text():
                said = "\n---\n".join(log.read_text() for log in logs)
                assert all(rank.poll() is None for rank in ranks), said
                assert time.monotonic() < deadline, said
                time.sleep(0.2)
            ranks[0].send_signal(signal.SIGINT)
            codes = [rank.wait(PATIENCE) for rank in ranks]
        finally:
            for process in ranks:
                process.kill()
    assert codes == [128 + signal.SIGINT, 0], [log.read_text() for log in logs]
    assert (tmp_path / "runs/far/summary.json").exists()
