"""Runs in MLflow: where its environment variables say, else in a store beside the runs.

A run's folder keeps the number that MLflow gave it, so that a resumed training goes on there.
"""

import contextlib
import logging
import os
import shlex
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

# Nobody who trains has asked to inform MLflow's makers of it.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")
# MLflow's own seven take minutes to find out that no server answers.
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "2")

import mlflow
from mlflow.entities import Metric, Param
from mlflow.exceptions import MlflowException

from trainers.trackers.values import (
    FAILED,
    FINISHED,
    INTERRUPTED,
    VALIDATION_LOSS,
    epochs,
    finals,
    parameters,
    standing_of,
)
from trainers.trained_run import TrainedRun
from trainers.training.fit import Standing
from trainers.training.runs import CONFIG, RunConfig
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import json_of, json_text, text_of, write_text_whole
from wakedeploy.core.locks import one_at_a_time

EXPERIMENT = "wakedeploy"
STORE, ARTIFACTS = "mlflow.db", "mlflow-artifacts"
KNOWN_AS = "mlflow.json"  # in a run's folder: its number in each store
_SEND_S = 2.0  # between two writes of metrics; each costs milliseconds
_AT_ONCE = 900  # metrics; MLflow takes a thousand
_STATUS = {FINISHED: "FINISHED", INTERRUPTED: "KILLED", FAILED: "FAILED"}


class MlFlow:
    """A store and its experiment: MLFLOW_TRACKING_URI, MLFLOW_EXPERIMENT_NAME or _ID are heeded."""

    failures: tuple[type[Exception], ...] = (MlflowException, OSError)

    def __init__(self, out: Path) -> None:
        logging.getLogger("mlflow").setLevel(os.environ.get("MLFLOW_LOGGING_LEVEL", "WARNING"))
        logging.getLogger("alembic").setLevel(logging.WARNING)
        given = os.environ.get("MLFLOW_TRACKING_URI")
        address = given or f"sqlite:///{out.absolute() / STORE}"
        self._secret = urlsplit(address).netloc.rpartition("@")[0]
        self.store = self._shown(address)
        # The tables of a new store are made by one process.
        turn = contextlib.nullcontext() if given else one_at_a_time(out, "mlflow")
        try:
            with turn:
                mlflow.set_tracking_uri(address)
                self.experiment = _experiment(None if given else out.absolute() / ARTIFACTS)
        except self.failures as error:
            raise UnusableInput(
                f"--tracker mlflow: the store {self.store} cannot be used ({self.why(error)}); set"
                " MLFLOW_TRACKING_URI to another, or leave it out for one beside the runs."
            ) from error
        self.whereabouts = (
            f"MLflow: runs go into {self.store}, experiment {self.experiment.name}"
            + (
                "."
                if given
                else f"; look with `mlflow ui --backend-store-uri {shlex.quote(self.store)}`."
            )
        )

    def why(self, failure: Exception) -> str:
        """A failure in one line, without the password of the store's address."""
        return self._shown(one_line(failure))

    def _shown(self, text: str) -> str:
        return text.replace(f"{self._secret}@", "") if self._secret else text

    def track(self, config: RunConfig, folder: Path, fresh: bool) -> "_Run":
        """A run, which goes on as what it was before in this store."""
        return _Run(self, config, folder, fresh)


class _Run:
    def __init__(self, to: MlFlow, config: RunConfig, folder: Path, fresh: bool) -> None:
        self._to, self._config, self._folder, self._fresh = to, config, folder, fresh
        self._client = mlflow.MlflowClient()
        self._id, self._done = "", False
        self._epochs = 0
        self._unsent: list[Any] = []
        self._sent_s = 0.0

    def stands(self, standing: Standing) -> None:
        """Report the epochs not reported yet."""
        self._open()
        for epoch, values in epochs(self._config, standing, self._epochs):
            self._say(values, epoch)
        self._epochs = max(self._epochs, standing.epoch)
        if time.monotonic() > self._sent_s + _SEND_S:
            self._send()

    def finished(self, run: TrainedRun, pictures: Sequence[Path]) -> None:
        """The scores at the epoch that they are of, the configuration and the pictures."""
        self.stands(standing_of(run.metrics))
        if self._done:
            return
        self._say(finals(run.metrics), run.metrics.best_epoch)
        self._send()
        for path in (self._folder / CONFIG, *pictures):
            self._client.log_artifact(self._id, str(path))

    def close(self, how: str) -> None:
        """The run's state in MLflow."""
        if self._id:
            self._send()
            mlflow.end_run(_STATUS[how])

    def _open(self) -> None:
        if self._id:
            return
        if mlflow.active_run() is not None:  # the one before, whose end could not be reported
            mlflow.end_run(_STATUS[FAILED])
        before = self._before()
        if before is None:
            name = f"{self._config.arch} s{self._config.seed} on {self._config.domain}"
            began = mlflow.start_run(experiment_id=self._to.experiment.experiment_id, run_name=name)
            self._remember(began.info.run_id)
            params = [Param(n, str(value)) for n, value in parameters(self._config).items()]
            self._client.log_batch(began.info.run_id, params=params)
        else:
            began = mlflow.start_run(run_id=before.info.run_id)
            self._done = before.info.status == "FINISHED"
            there = self._client.get_metric_history(began.info.run_id, VALIDATION_LOSS)
            self._epochs = max((metric.step for metric in there), default=0)
        self._id = began.info.run_id

    def _before(self) -> Any:
        """What this run was before in this store; None where it was not, or is deleted."""
        number = self._known().get(self._to.store)
        if number is None or self._fresh:
            return None
        try:
            run = self._client.get_run(number)
        except MlflowException as error:
            if error.error_code != "RESOURCE_DOES_NOT_EXIST":
                raise
            return None
        return run if run.info.lifecycle_stage == "active" else None

    def _known(self) -> dict[str, str]:
        try:
            known = json_of(text_of(self._folder / KNOWN_AS))
        except (OSError, ValueError):  # none yet, or one of which nothing can be learned
            return {}
        return known if isinstance(known, dict) else {}

    def _remember(self, number: str) -> None:
        known = {**self._known(), self._to.store: number}
        write_text_whole(self._folder / KNOWN_AS, json_text(known))

    def _say(self, values: Mapping[str, float], step: int) -> None:
        now_ms = int(1e3 * time.time())
        self._unsent += [Metric(name, value, now_ms, step) for name, value in values.items()]

    def _send(self) -> None:
        while self._unsent:
            some, self._unsent = self._unsent[:_AT_ONCE], self._unsent[_AT_ONCE:]
            self._client.log_batch(self._id, metrics=some)
        self._sent_s = time.monotonic()


def _experiment(artifacts: Path | None) -> Any:
    """The experiment that the environment names, else ours; made where it is not there."""
    client = mlflow.MlflowClient()
    name = os.environ.get("MLFLOW_EXPERIMENT_NAME")
    number = os.environ.get("MLFLOW_EXPERIMENT_ID")
    if number and not name:
        return client.get_experiment(number)
    found = client.get_experiment_by_name(name or EXPERIMENT)
    if found is not None:
        return found
    place = artifacts.as_uri() if artifacts is not None else None
    return client.get_experiment(client.create_experiment(name or EXPERIMENT, place))
