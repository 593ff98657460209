"""How many processes a command takes when nobody says."""

import os

import click
import pytest
from click.testing import CliRunner

from wakedeploy.cli.workers import workers_option


@click.command()
@workers_option()
def shared(workers: int) -> None:
    click.echo(workers)


@pytest.mark.parametrize(("cores", "told"), [({0}, 1), ({1, 3, 5}, 3), (set(range(64)), 16)])
def test_there_is_one_for_each_core_that_may_be_used(monkeypatch, cores, told) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: cores)
    assert CliRunner().invoke(shared).output == f"{told}\n"


def test_as_many_as_are_asked_for() -> None:
    assert CliRunner().invoke(shared, ["--workers", "40"]).output == "40\n"
    assert CliRunner().invoke(shared, ["--workers", "0"]).exit_code == 2
