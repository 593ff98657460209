"""`optuna-dashboard`, as it is installed, shows a study that `tune` made."""

import contextlib
import json
import socket
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest
from small_study import tuned

from trainers.tuning.storage import JOURNAL
from wakedeploy.core.episodes import EpisodeSet

pytest.importorskip("optuna_dashboard", reason="optuna-dashboard is not installed")


def asked(port: int, path: str) -> Any:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as reply:
        return json.load(reply)


@pytest.mark.whole
def test_the_dashboard_lists_the_study_and_its_trials(echo: EpisodeSet, tmp_path: Path) -> None:
    study = tuned(echo, tmp_path / "out", trials=3)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    code = "import sys; from optuna_dashboard._cli import main; sys.exit(main())"
    served = subprocess.Popen(
        [sys.executable, "-c", code, "--host", "127.0.0.1", "--port", str(port),
         str(tmp_path / "out" / JOURNAL)],
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        end, studies = time.monotonic() + 60, None
        while studies is None and time.monotonic() < end:
            with contextlib.suppress(OSError):
                studies = asked(port, "/api/studies")
            time.sleep(0.1)
        assert studies is not None
        (summary,) = studies["study_summaries"]
        assert summary["study_name"] == "echo-agile-mlp"
        told = asked(port, f"/api/studies/{summary['study_id']}?after=0")
        assert [trial["number"] for trial in told["trials"]] == [0, 1, 2]
        values = [float(value) for trial in told["trials"] for value in trial.get("values", [])]
        assert values == pytest.approx([v for t in study.trials for v in t.values or []])
    finally:
        served.kill()
        served.wait()
