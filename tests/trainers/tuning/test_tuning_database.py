"""A study in a real PostgreSQL server, which the tests start as an unprivileged user."""

import contextlib
import glob
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import hesitant
import needs
import optuna
import pytest
import sqlalchemy
import warm
from click.testing import CliRunner, Result
from optuna.trial import TrialState
from small_study import TINY, tuned, work_of

from trainers.tuning.conclude import conclude
from trainers.tuning.report import rows_of
from trainers.tuning.storage import JOURNAL, Place
from trainers.tuning.study import REFERENCE, this_worker
from trainers.tuning.workers import run_trials
from wakedeploy.cli import main
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import CheckFailed, UnusableInput

pytest.importorskip("psycopg", reason="psycopg, of wakedeploy[cluster], is not installed")

PASSWORD = "s3cret/p@ss"
QUOTED = "s3cret%2Fp%40ss"
LIMIT_S = 240  # beside other work


@dataclass(frozen=True)
class Server:
    """A server on a loopback port, its files in a folder of its user."""

    folder: Path
    port: int
    programs: Path
    as_user: tuple[str, ...]

    def run(self, program: str, *arguments: str) -> None:
        subprocess.run(
            [*self.as_user, str(self.programs / program), *arguments],
            cwd=self.folder, check=True, capture_output=True, timeout=LIMIT_S,
        )  # fmt: skip

    def start(self) -> None:
        options = (
            f"-p {self.port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={self.folder}"
            " -c fsync=off"
        )
        log = str(self.folder / "log")
        self.run("pg_ctl", "-D", str(self.folder / "data"), "-l", log, "-w", "-o", options, "start")

    def stop(self) -> None:
        self.run("pg_ctl", "-D", str(self.folder / "data"), "-m", "immediate", "-w", "stop")

    def url(self, database: str, password: str = QUOTED) -> str:
        return f"postgresql://tuner:{password}@127.0.0.1:{self.port}/{database}"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def unprivileged(folder: Path) -> tuple[str, ...]:
    """How to run a program as one who may start the server, which refuses root."""
    if os.geteuid() != 0:
        return ()
    user = "postgres"
    if shutil.which("runuser") is None:
        pytest.skip("there is no runuser to start PostgreSQL with as another user than root")
    try:
        shutil.chown(folder, user)
    except LookupError:
        pytest.skip(f"there is no user {user} to start PostgreSQL as")
    return ("runuser", "-u", user, "--")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    programs = sorted(glob.glob("/usr/lib/postgresql/*/bin/initdb"))
    if not programs:
        pytest.skip(f"{needs.NOT_INSTALLED}postgresql")
    # Not below pytest's own folder, which other users may not enter; sockets need a short path.
    folder = Path(tempfile.mkdtemp(prefix="pg-"))
    made = Server(folder, free_port(), Path(programs[-1]).parent, unprivileged(folder))
    (folder / "password").write_text(PASSWORD)
    (folder / "password").chmod(0o644)
    made.run(
        "initdb", "-D", str(folder / "data"), "-U", "tuner", "-A", "scram-sha-256", "-N",
        "--pwfile", str(folder / "password"),
    )  # fmt: skip
    made.start()
    yield made
    with contextlib.suppress(subprocess.CalledProcessError):
        made.stop()
    shutil.rmtree(folder)


@pytest.fixture
def address(server: Server, request: pytest.FixtureRequest) -> str:
    """The URL of an empty database of this test's own."""
    name = f"t{abs(hash(request.node.name)) % 10**9}"
    engine = sqlalchemy.create_engine(
        server.url("postgres").replace("postgresql:", "postgresql+psycopg:"),
        isolation_level="AUTOCOMMIT",
    )
    with engine.connect() as connection:
        connection.execute(sqlalchemy.text(f"CREATE DATABASE {name}"))
    engine.dispose()
    return server.url(name)


def executed(address: str, statement: str) -> None:
    engine = sqlalchemy.create_engine(address.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.execute(sqlalchemy.text(statement))
    engine.dispose()


def tune(data: EpisodeSet, folder: Path, address: str, *others: object) -> Result:
    if not (folder / "set").exists():
        data.write(folder / "set")
    asked = ["tune", "--arch", "agile-mlp", "--data", folder / "set", "--out", folder / "out"]
    asked += ["--epochs", 3, "--seed", 0, "--storage", address, *others]
    for dimension in TINY["agile-mlp"]:
        asked += ["--dimension", dimension]
    return CliRunner().invoke(main, [str(one) for one in asked])


@pytest.mark.whole
def test_two_machines_share_a_study_in_the_database(
    echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    first = tune(echo, tmp_path, address, "--trials", 4, "--workers", 2)
    assert first.exit_code == 0, first.output
    assert PASSWORD not in first.output
    assert len(work_of(echo, tmp_path / "elsewhere", address=address).open().trials) == 4
    other = tuned(echo, tmp_path / "elsewhere", trials=7, address=address)
    assert [t.state.is_finished() for t in other.trials] == [True] * 7
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert "study.journal" not in left
    told = (tmp_path / "out" / "best.toml").read_text()
    assert "tuner:***@127.0.0.1" in told
    for secret in (PASSWORD, QUOTED):
        assert all(
            secret.encode() not in p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()
        )
    refused = tune(echo, tmp_path, address, "--seed", 3)
    assert refused.exit_code == 2
    assert "made with seed = 0, not 3; repeat its options, or choose another --study-name" in (
        " ".join(refused.output.split())
    )
    assert PASSWORD not in refused.output
    overwriting = tune(echo, tmp_path, address, "--study-name", "another")
    assert overwriting.exit_code == 2
    assert "best.toml is of another study (name = echo-agile-mlp, not another)" in (
        " ".join(overwriting.output.split())
    )


@pytest.mark.slow
def test_two_machines_at_once_do_neither_more_trials_nor_the_paper_s_shape_twice(
    echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    echo.write(tmp_path / "set")
    (tmp_path / "ready").mkdir()
    asked = ["tune", "--arch", "agile-mlp", "--data", tmp_path / "set", "--storage", address,
             "--epochs", 1, "--trials", 3, "--seed", 0, "--dimension", "batch=256"]  # fmt: skip
    machines = [
        warm.started(
            tmp_path / f"{name}.log",
            hesitant.tune,
            tmp_path / "ready",
            [str(part) for part in [*asked, "--out", tmp_path / name]],
        )
        for name in ("here", "there")
    ]
    try:
        for machine in machines:
            machine.join(LIMIT_S)
    finally:
        for machine in machines:
            machine.kill()
    told = [(tmp_path / f"{name}.log").read_text() for name in ("here", "there")]
    assert [machine.exitcode for machine in machines] == [0, 0], told
    work = work_of(echo, tmp_path / "look", address=address, epochs=1, asked=("batch=256",))
    trials = work.open().trials
    assert len({trial.user_attrs["worker"]["pid"] for trial in trials}) == 2
    assert [trial.state.is_finished() for trial in trials] == [True] * 3
    assert [REFERENCE in trial.user_attrs for trial in trials] == [True, False, False]


@pytest.mark.whole
def test_the_turn_of_a_killed_process_is_over(tmp_path: Path, address: str) -> None:
    code = (
        "import sys, time; from pathlib import Path\n"
        "from trainers.tuning.storage import Place\n"
        "with Place(Path('x'), sys.argv[1]).turn('study'):\n"
        "    print('held', flush=True); time.sleep(60)"
    )
    holder = subprocess.Popen([sys.executable, "-c", code, address], stdout=subprocess.PIPE)
    assert holder.stdout is not None
    assert holder.stdout.readline() == b"held\n"
    place = Place(tmp_path, address)
    with place.turn("another study"):
        pass
    threading.Timer(0.5, holder.kill).start()
    began = time.monotonic()
    with place.turn("study") as leave:
        assert time.monotonic() - began > 0.4
        leave()
        with place.turn("study"):
            pass
    holder.wait()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_a_study_in_the_database_is_that_in_the_journal(
    echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    journal = tuned(echo, tmp_path / "journal", trials=12)
    database = tuned(echo, tmp_path / "database", trials=12, address=address)
    assert [t.params for t in database.trials] == [t.params for t in journal.trials]
    assert [t.values for t in database.trials] == [t.values for t in journal.trials]


@pytest.mark.whole
def test_a_trial_whose_machine_fell_silent_is_begun_again(
    echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    work = work_of(echo, tmp_path / "out", trials=2, address=address)
    study = work.begin()
    with pytest.warns(UserWarning, match="Heartbeat"):  # ask() alone lets no heart beat
        silent = study.ask()
    hidden = silent.suggest_int("hidden", 4, 16, log=True)
    silent.set_user_attr("worker", {**this_worker(), "host": "elsewhere"})
    silent.storage._backend.record_heartbeat(silent._trial_id)
    run_trials(work, study, echo)
    assert study.trials[0].state == TrialState.RUNNING  # it may still be at work
    assert len(study.trials) == 2
    executed(address, "UPDATE trial_heartbeats SET heartbeat = heartbeat - interval '1 hour'")
    tuned(echo, tmp_path / "out", trials=3, address=address)
    rows = rows_of(work.open())
    assert (rows[0].state, rows[0].reason) == ("lost", "its process ended; begun again")
    assert [row.state for row in rows[1:]] == ["finished"] * 3
    assert hidden in [row.point["hidden"] for row in rows[2:]]


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda url: url.replace(QUOTED, "wr0ng-one"), "password authentication failed"),
        (lambda url: url.rsplit("/", 1)[0] + "/nowhere", 'database "nowhere" does not exist'),
        (lambda url: url.rsplit(":", 1)[0] + ":1/x", "onnection refused"),
        (lambda url: url + "?password=wr0ng-one", "password authentication failed"),
    ],
)
def test_an_unreachable_database_is_one_sentence_without_the_password(
    spoil, says: str, echo: EpisodeSet, tmp_path: Path, server: Server
) -> None:
    ended = tune(echo, tmp_path, spoil(server.url("postgres")), "--trials", 1)
    assert ended.exit_code == 2, ended.output
    told = " ".join(ended.output.split())
    assert says in told
    assert "cannot be reached" in told
    assert len(ended.stderr.strip().splitlines()) == 1
    assert "unexpected" not in told
    for secret in (PASSWORD, QUOTED, "wr0ng-one"):
        assert secret not in told


@pytest.mark.parametrize(
    ("name", "content"),
    [("thesis.txt", "mine"), ("trials.csv", "mine"), (JOURNAL, ""), ("best", "mine")],
)
def test_a_folder_with_other_things_is_left_alone(
    name: str, content: str, echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    work = work_of(echo, tmp_path / "out", address=address)
    work.out.mkdir()
    (work.out / name).write_text(content)
    told = f"a study of its own, {name}" if name == JOURNAL else f"{name} and no study"
    with pytest.raises(UnusableInput, match=f"holds {told}; choose another --out"):
        work.begin()
    assert [(path.name, path.read_text()) for path in work.out.iterdir()] == [(name, content)]


@pytest.mark.whole
def test_a_folder_with_nothing_but_trials_is_gone_on_in(
    echo: EpisodeSet, tmp_path: Path, address: str
) -> None:
    work = work_of(echo, tmp_path / "out", trials=2, budget=10, address=address)
    study = work.begin()
    run_trials(work, study, echo)
    with pytest.raises(CheckFailed, match="No trial came to its end"):
        conclude(work, study, echo)
    assert [p.name for p in work.out.iterdir() if p.name[0] != "."] == ["trials.csv"]
    assert len(work.begin().trials) == 2


@pytest.mark.whole
def test_a_database_that_goes_away_is_told_and_the_study_goes_on_later(
    echo: EpisodeSet, tmp_path: Path, address: str, server: Server
) -> None:
    def stop_once(study: optuna.Study) -> None:
        if len(study.trials) == 2:
            server.stop()

    try:
        with pytest.raises(UnusableInput, match="cannot be reached") as told:
            tuned(echo, tmp_path / "out", trials=5, address=address, on_trials=stop_once)
        assert "\n" not in str(told.value)
        assert PASSWORD not in str(told.value)
    finally:
        server.start()
    study = tuned(echo, tmp_path / "out", trials=5, address=address)
    assert sum(t.state.is_finished() for t in study.trials) == 5


def test_only_postgresql_is_taken_for_an_address(tmp_path: Path) -> None:
    for address in ("sqlite:///x.db", "postgresql://host", "postgresql://me:s3cret@", "", "::"):
        with pytest.raises(UnusableInput, match="give a database as postgresql://") as told:
            Place(tmp_path, address)
        assert "s3cret" not in str(told.value)
    shown = Place(tmp_path, "postgresql://me:s3cret@h/d?sslpassword=s3cret&application_name=a").name
    assert shown == "postgresql://me:***@h/d?application_name=a&sslpassword=***"
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "spelling",
    [
        "postgresql+psycopg://me:other@h/d?a=1&b=2",
        "postgresql://me@H:5432/d?b=2&a=1",
        "postgresql://me:***@h:5432/d?a=1&b=2",
    ],
)
def test_a_database_is_the_same_however_it_is_spelt(spelling: str, tmp_path: Path) -> None:
    def without_password(told: str) -> str:
        return told.replace(":***", "")

    told = without_password(Place(tmp_path, spelling).portable_name)
    assert told == "postgresql://me@h/d?a=1&b=2"
    assert Place(tmp_path, spelling.replace("5432", "5433")).portable_name.count("5433") == (
        spelling.count("5432")
    )


def test_without_psycopg_it_is_said_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    place = Place(tmp_path, "postgresql://me@h/d")
    with pytest.raises(UnusableInput, match=r"-m pip install .* '\.\[cluster\]'"):
        place.open(lambda study, trial: None)
    with pytest.raises(UnusableInput, match="-m pip install"), place.turn("study"):
        pass


def test_a_mute_server_is_given_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A server that takes connections and says nothing is given up after some seconds."""
    monkeypatch.setattr("trainers.tuning.storage._CONNECT_S", 2)
    with socket.socket() as mute:
        mute.bind(("127.0.0.1", 0))
        mute.listen()
        place = Place(tmp_path, f"postgresql://me@127.0.0.1:{mute.getsockname()[1]}/d")
        with pytest.raises(UnusableInput, match="cannot be reached"):
            place.open(lambda study, trial: None)
