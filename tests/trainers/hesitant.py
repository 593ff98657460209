"""A tune in which much may happen between a look at the study and what follows from it."""

import os
import time
from pathlib import Path

import optuna

from trainers.tuning import workers
from wakedeploy.cli import main


def tune(ready: Path, arguments: list[str]) -> None:
    """Tune as asked, as soon as two processes have come to `ready`."""
    counted, enqueued = workers._remaining, optuna.Study.enqueue_trial

    def remaining(study, wanted):
        found = counted(study, wanted)
        time.sleep(0.5)
        return found

    def enqueue_trial(*asked, **others):
        time.sleep(1)
        enqueued(*asked, **others)

    workers._remaining, optuna.Study.enqueue_trial = remaining, enqueue_trial
    (ready / str(os.getpid())).touch()
    while len(list(ready.iterdir())) < 2:
        time.sleep(0.05)
    main(arguments)
