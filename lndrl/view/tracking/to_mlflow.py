"""A run in MLflow: where MLFLOW_TRACKING_URI says, else in the working folder.

A run is found again by its tag ``lndrl.run_id``, so a resumed one goes on there; what it has
already is a tag, too, written after each batch.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from lndrl.view.run_rows import scalars_of
from lndrl.view.tracking.feed import Row, made_at
from lndrl.view.tracking.publish import RunFacts, TrackerError, plain, quiet_modules

_SENT, _RUN_ID = "lndrl.sent_unix", "lndrl.run_id"
_MOST_METRICS, _MOST_PARAMS, _LONGEST_PARAM = 1000, 100, 500  # of one request; letters
T = TypeVar("T")


class MlflowTracker:
    """See ``Tracker``. The experiment is MLFLOW_EXPERIMENT_NAME, else ``lndrl``."""

    def __init__(self, facts: RunFacts) -> None:
        # Of a folder, which MLflow otherwise refuses, and of what it would tell its makers.
        os.environ.setdefault("MLFLOW_ALLOW_FILE_STORE", "true")
        os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
        # It would go on for minutes by itself; what fails is tried again anyway.
        os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")
        os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")
        quiet_modules("mlflow", "alembic")
        from mlflow import MlflowClient

        uri = os.environ.get("MLFLOW_TRACKING_URI") or _default_uri()
        name = os.environ.get("MLFLOW_EXPERIMENT_NAME") or "lndrl"
        self.where = f"MLflow at {plain(ValueError(uri))}, experiment {name}, run {facts.name}"
        self._client = _try(lambda: MlflowClient(tracking_uri=uri))
        self._run = _try(lambda: self._found(facts, name))

    def sent(self) -> float:
        """See ``Tracker``."""
        return float(self._run.data.tags.get(_SENT, 0.0))

    def send(self, rows: Sequence[Row]) -> None:
        """See ``Tracker``."""
        metrics = [each for row in rows for each in _metrics(row)]
        run_id = self._run.info.run_id

        def work() -> None:
            for i in range(0, len(metrics), _MOST_METRICS):
                self._client.log_batch(run_id, metrics=metrics[i : i + _MOST_METRICS])
            self._client.set_tag(run_id, _SENT, repr(made_at(rows[-1])))

        _try(work)

    def finish(self, ended: bool) -> None:
        """See ``Tracker``."""
        status = "FINISHED" if ended else "KILLED"
        _try(lambda: self._client.set_terminated(self._run.info.run_id, status))

    def _found(self, facts: RunFacts, name: str) -> Any:
        from mlflow.entities import Param

        experiment = self._client.get_experiment_by_name(name)
        number = experiment.experiment_id if experiment else self._client.create_experiment(name)
        known = self._client.search_runs([number], f"tags.`{_RUN_ID}` = '{facts.run_id}'")
        config = {key: str(value)[:_LONGEST_PARAM] for key, value in facts.config.items()}
        if known:
            self._client.update_run(known[0].info.run_id, "RUNNING")
            had = known[0].data.params
            for key, value in config.items():
                if key in had and had[key] != value:  # a parameter there never changes
                    self._client.set_tag(known[0].info.run_id, f"changed.{key}", value)
            return known[0]
        tags = {_RUN_ID: facts.run_id, "lndrl.version": facts.version}
        run = self._client.create_run(number, run_name=facts.name, tags=tags)
        params = [Param(key, value) for key, value in config.items()]
        for i in range(0, len(params), _MOST_PARAMS):
            self._client.log_batch(run.info.run_id, params=params[i : i + _MOST_PARAMS])
        return run


def _metrics(row: Row) -> Iterator[Any]:
    from mlflow.entities import Metric

    when = int(1000 * made_at(row))
    steps = int(row["validation"]["steps"] if "validation" in row else row["steps"])
    for name, value in scalars_of(row).items():
        yield Metric(name, value, when, steps)


def _default_uri() -> str:
    """A database as MLflow has it, where all of it is installed; else a folder."""
    if find_spec("sqlalchemy") is not None:
        return f"sqlite:///{Path('mlflow.db').absolute()}"
    return Path("mlruns").absolute().as_uri()


def _try(work: Callable[[], T]) -> T:
    """``work``'s result; whatever it raises as a TrackerError."""
    try:
        return work()
    except Exception as error:  # its stores raise what their databases and networks do
        raise TrackerError(f"MLflow: {plain(error)}") from None
