"""One short training, watched by a real Prometheus: every query of the dashboard and every rule."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import chdir, redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema import Draft202012Validator

from lndrl.chaos.stage import descendants, is_worker
from lndrl.cli.main import run as lndrl
from lndrl.config.schema import schema_file
from lndrl.machine.ports import free_port
from lndrl.view.run_rows import scalars_of
from tests.deploy.test_grafana import GRAFANA, panels

ROOT = Path(__file__).resolve().parent.parent
PATIENCE = 600.0  # s; compiling on a busy machine takes long
SMALL: dict[str, Any] = {
    "scenario": "hybrid",
    "network": {"map_channels": [4, 4, 8], "features": 16, "goal_features": 8},
    "ppo": {"batch_size": 64, "minibatch_size": 32, "epochs": 1},
    "learner": {"total_steps": 1_000_000, "checkpoint_interval": 2, "threads": 1},
    "actor": {"count": 1, "worlds": 2, "horizon": 16},
    "localization": {"min_particles": 100, "max_particles": 200},
    "task": {"time_limit": 4},
}
SETTINGS = ["learner.validation_episodes=1", "learner.validation_share=1"]
TRACKERS = [name for name in ("wandb", "mlflow") if find_spec(name) is not None]
FOLLOWING = "next: lndrl report runs/a  # one page about it\n"
SECRET = "0123456789abcdef0123456789abcdef01234567"  # of the form that W&B's keys have
# Of panels whose figures this training cannot have: it waits for nobody and drops nothing.
MAY_BE_EMPTY: set[str] = set()


@dataclass
class Live:
    """A training that goes on, its folder, and where its metrics are."""

    folder: Path
    port: int
    process: subprocess.Popen[str]

    def end(self) -> None:
        """As a user ends it, once trackers are there; nothing happens where it has ended."""
        if self.process.poll() is None:
            words = [f"[log] {name}: to " for name in TRACKERS]
            here = lambda: all(word in self.log() for word in words)  # noqa: E731
            # They are of low priority: who simulates would only keep them from starting.
            workers = [pid for pid in descendants(self.process.pid) if is_worker(pid)]
            for pid in workers:
                os.kill(pid, signal.SIGSTOP)
            try:
                wait("trackers", here, self.process, self.folder / "log")
            finally:
                for pid in workers:
                    os.kill(pid, signal.SIGCONT)
            self.process.send_signal(signal.SIGINT)
        assert self.process.wait(PATIENCE) == 130, self.log()
        assert "Traceback" not in self.log()

    def log(self) -> str:
        return (self.folder / "log").read_text()

    def rows(self) -> list[dict[str, Any]]:
        text = (self.folder / "runs/a/metrics.jsonl").read_text()
        return [json.loads(line) for line in text[: text.rfind("\n")].splitlines()]

    def metrics(self) -> str:
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/metrics", timeout=30) as answer:
            text: str = answer.read().decode()
        return text


def wait(what: str, condition: Callable[[], Any], process: subprocess.Popen[str], log: Path) -> Any:
    deadline = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert process.poll() is None and time.monotonic() < deadline, f"{what}: {log.read_text()}"
        time.sleep(0.2)
    return found


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    folder = tmp_path_factory.mktemp("live")
    (folder / "small.yaml").write_text(yaml.safe_dump(SMALL))
    port, log = free_port(), folder / "log"
    command = [
        *(sys.executable, "-m", "lndrl", "train", "small.yaml", "--run", "a", "--no-dashboard"),
        *("--listen", f"tcp/127.0.0.1:{free_port()}", "--metrics-port", str(port)),
        *(word for name in TRACKERS for word in ("--log", name)),
        *("--set", *SETTINGS),
    ]
    environment = {
        **{name: os.environ[name] for name in os.environ if name[:5] not in ("WANDB", "MLFLO")},
        **{"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
        **{"WANDB_MODE": "offline", "WANDB_API_KEY": SECRET, "MLFLOW_TRACKING_PASSWORD": SECRET},
    }
    with log.open("w") as file:
        process = subprocess.Popen(
            command, cwd=folder, env=environment, stdout=file, stderr=file, text=True
        )
    found = Live(folder, port, process)
    try:
        wait("validated", lambda: "[validated]" in log.read_text(), process, log)
        yield found
        found.end()
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def prometheus(live: Live, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Where a Prometheus answers that has scraped ``live`` for some seconds, by our rules."""
    if shutil.which("prometheus") is None:
        pytest.skip("needs Prometheus (package prometheus), which is not installed")
    folder, port = tmp_path_factory.mktemp("prometheus"), free_port()
    config = yaml.safe_load((GRAFANA / "prometheus.yml").read_text())
    config["global"] = {"scrape_interval": "500ms", "evaluation_interval": "1s"}
    config["rule_files"] = [str(GRAFANA / "rules.yml")]
    config["scrape_configs"][0]["static_configs"][0]["targets"] = [f"127.0.0.1:{live.port}"]
    (folder / "prometheus.yml").write_text(yaml.safe_dump(config))
    log = folder / "log"
    with log.open("w") as file:
        process = subprocess.Popen(
            [
                *("prometheus", f"--config.file={folder / 'prometheus.yml'}"),
                f"--storage.tsdb.path={folder / 'data'}",
                f"--web.listen-address=127.0.0.1:{port}",
            ],
            stdout=file,
            stderr=file,
            text=True,
        )
    url = f"http://127.0.0.1:{port}"
    try:
        wait("scrapes", lambda: enough(url), process, log)
        yield url
    finally:
        process.terminate()
        process.wait(30)


def enough(url: str) -> bool:
    """Whether there are some scrapes, and rules were gone through."""
    try:
        scrapes = asked(url, "query", query="count_over_time(lndrl_up[1m])")["result"]
        groups = asked(url, "rules")["groups"]
    except (OSError, AssertionError):  # it says that it is not ready with the status 503
        return False
    return bool(scrapes) and float(scrapes[0]["value"][1]) >= 6 and groups[0]["evaluationTime"] > 0


def asked(url: str, what: str, **arguments: str) -> dict[str, Any]:
    query = urllib.parse.urlencode(arguments)
    try:
        with urllib.request.urlopen(f"{url}/api/v1/{what}?{query}", timeout=30) as answer:
            data: dict[str, Any] = json.load(answer)["data"]
    except urllib.error.HTTPError as error:
        raise AssertionError(error.read().decode()) from None
    return data


def test_every_query_of_the_dashboard_has_data(prometheus: str) -> None:
    empty = set()
    for panel in panels():
        for target in panel.get("targets", []):
            text = target["expr"].replace("$instance", ".*").replace("$__rate_interval", "30s")
            result = asked(prometheus, "query", query=text)["result"]
            if not result:
                empty.add(f"{panel['title']}: {text}")
            labels = {name for series in result for name in series["metric"]}
            legend = target["legendFormat"]
            assert all(f"{{{{{name}}}}}" not in legend or name in labels for name in labels)
    assert empty <= MAY_BE_EMPTY


def test_rules_are_understood_and_a_training_that_goes_well_alarms_nobody(prometheus: str) -> None:
    (group,) = asked(prometheus, "rules")["groups"]
    assert len(group["rules"]) >= 10
    for rule in group["rules"]:
        assert (rule["health"], rule.get("lastError", "")) == ("ok", ""), rule["name"]
        if rule["name"] != "LndrlMemoryShort":  # which is this machine's affair
            assert rule["state"] != "firing", rule["name"]


def test_counts_are_those_of_the_run(live: Live) -> None:
    def values() -> dict[str, float]:
        lines = live.metrics().splitlines()
        pairs = [line.rpartition(" ") for line in lines if not line.startswith("#")]
        return {name: float(value) for name, _, value in pairs}

    found = values()
    assert found["lndrl_steps_total"] == 64 * found["lndrl_updates_total"] > 0
    assert found["lndrl_weights_sent_bytes_total"] > 0
    assert found['lndrl_uploads_total{answer="accepted"}'] >= found["lndrl_updates_total"]
    assert "metrics at http://127.0.0.1:" in (live.folder / "log").read_text()


def test_every_line_that_a_run_writes_is_as_the_schema_says(live: Live) -> None:
    rows = live.rows()
    checker = Draft202012Validator(json.loads(schema_file("metrics").read_text()))
    for row in rows:
        assert [error.message for error in checker.iter_errors(row)] == []
        assert scalars_of(row)
    (validated,) = {"validation" in row for row in rows} - {False}
    assert validated
    for key, value in (("updates", 3), ("update", -1), ("update", "3"), ("ppo", {"kl2": 0.1})):
        assert not checker.is_valid({**rows[0], key: value}), key


def logged(live: Live, name: str) -> list[str]:
    """What the tracker's process has said, as events of the run."""
    return [
        line.partition(f"[log] {name}: ")[2]
        for line in live.log().splitlines()
        if f"[log] {name}: " in line
    ]


def rest_sent(live: Live, name: str) -> str:
    """``lndrl log`` by hand: what a tracker had no time for, as an event of the run asks."""
    out = io.StringIO()
    with chdir(live.folder), redirect_stdout(out):
        assert lndrl(["log", "runs/a", "--to", name]) == 0
    return out.getvalue()


def again(live: Live, name: str) -> str:
    """``lndrl log`` on the run as a resume leaves it: two updates are cut, one is done again."""
    path = live.folder / "runs/a/metrics.jsonl"
    *kept, last = [row for row in live.rows() if "ppo" in row]
    last["time"]["unix"] = time.time()
    path.write_text("".join(json.dumps(row) + "\n" for row in [*kept[:-1], last]))
    return rest_sent(live, name)


@pytest.mark.skipif("mlflow" not in TRACKERS, reason="needs mlflow or mlflow-skinny")
def test_mlflow_has_every_row_once_and_a_resumed_run_goes_on_there(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    live.end()
    monkeypatch.setenv("MLFLOW_ALLOW_FILE_STORE", "true")
    monkeypatch.setenv("MLFLOW_DISABLE_TELEMETRY", "true")
    from mlflow import MlflowClient

    rows = live.rows()
    assert logged(live, "mlflow")[0].startswith("to MLflow")
    rest_sent(live, "mlflow")
    database = live.folder / "mlflow.db"
    where = f"sqlite:///{database}" if database.exists() else (live.folder / "mlruns").as_uri()
    client = MlflowClient(tracking_uri=where)
    experiment = client.get_experiment_by_name("lndrl")
    assert experiment is not None
    (run,) = client.search_runs([experiment.experiment_id])
    assert (run.info.run_name, run.info.status) == ("a", "KILLED")
    assert run.data.params["ppo.batch_size"] == "64"
    trained = [row for row in rows if "ppo" in row]

    def steps(name: str) -> list[int]:
        return [each.step for each in client.get_metric_history(run.info.run_id, name)]

    assert steps("ppo/kl") == [row["steps"] for row in trained]
    assert len(steps("validation_greedy/arrived")) == len(rows) - len(trained)
    assert again(live, "mlflow") == f"1 row sent\n{FOLLOWING}"
    assert steps("ppo/kl") == [*(row["steps"] for row in trained), trained[-1]["steps"]]
    assert len(client.search_runs([experiment.experiment_id])) == 1


@pytest.mark.skipif("wandb" not in TRACKERS, reason="needs wandb")
def test_wandb_has_every_row_offline_and_no_secret_is_written(
    live: Live, monkeypatch: pytest.MonkeyPatch
) -> None:
    live.end()
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_API_KEY", SECRET)
    said = logged(live, "wandb")
    assert said[0].startswith("to Weights & Biases, offline in ")
    try:
        rest_sent(live, "wandb")
        count = sum(kept(path) for path in live.folder.glob("runs/a/wandb/offline-run-*/*.wandb"))
        assert count >= len(live.rows()) > 3
        assert again(live, "wandb").endswith(f"1 row sent\n{FOLLOWING}")
    finally:
        import wandb

        wandb.teardown()  # its service is a process of its own
    files = sorted((live.folder / "runs/a/wandb").glob("offline-run-*/*.wandb"))
    assert sum(map(kept, files)) == count + 1
    assert len({path.stem for path in files}) == 1, "the same run"
    for path in live.folder.rglob("*"):
        assert not path.is_file() or SECRET.encode() not in path.read_bytes(), path


def kept(path: Path) -> int:
    """Rows with a step in what W&B keeps offline."""
    from wandb.proto import wandb_internal_pb2

    count = 0
    for data in records(path.read_bytes()):
        record = wandb_internal_pb2.Record()
        record.ParseFromString(data)
        count += "steps" in {item.key or ".".join(item.nested_key) for item in record.history.item}
    return count


def records(data: bytes) -> Iterator[bytes]:
    """The records of a log as LevelDB writes it, behind W&B's own seven bytes.

    Blocks of 32 kB hold pieces with a checksum (4 bytes), a length (2) and a kind (1): whole,
    first, middle or last of a record.
    """
    block, head, whole, last = 32768, 7, 1, 4
    position, record = head, b""
    while position + head <= len(data):
        left = block - position % block
        if left < head:
            position += left
            continue
        size, kind = int.from_bytes(data[position + 4 : position + 6], "little"), data[position + 6]
        record += data[position + head : position + head + size]
        position += head + size
        if kind in (whole, last):
            yield record
            record = b""
