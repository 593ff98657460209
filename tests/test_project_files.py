"""What stands beside the code agrees with it: lock, licence, citation, change log, CI."""

import re
import subprocess
import tomllib
from importlib.metadata import requires
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import wakedeploy

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
CUDA = re.compile(r"triton|(cuda|nvidia)-")
PIN = re.compile(r"([a-z0-9.-]+)==(\S+?)(?: ; .*)?")


def pins(file: str) -> dict[str, tuple[str, list[str]]]:
    """What a file of pins says of each package: its version, and its hashes."""
    lines = (ROOT / file).read_text().replace(" \\\n", " ").splitlines()
    found = {}
    for line in lines:
        if line and not line.lstrip().startswith("#"):
            pin, *hashes = re.split(r"\s+--hash=", line)
            name, version = PIN.fullmatch(pin.strip()).groups()
            assert name not in found, f"{file} pins {name} twice"
            found[name] = (version, hashes)
    return found


def asked(*extras: str) -> list[Requirement]:
    """What pyproject.toml asks for, with these extras."""
    texts = PROJECT["dependencies"] + [text for extra in extras for text in EXTRAS[extra]]
    return [Requirement(text) for text in texts]


LOCK, CONSTRAINTS = pins("requirements.lock"), pins("constraints.txt")


@pytest.mark.parametrize("requirement", asked("train", "dev"), ids=lambda r: r.name)
def test_the_lock_has_a_version_of_each_requirement_that_fits(requirement):
    if requirement.name != "torch":
        assert LOCK[canonicalize_name(requirement.name)][0] in requirement.specifier


@pytest.mark.parametrize("requirement", asked(*EXTRAS), ids=lambda r: r.name)
def test_the_constraints_have_a_version_of_each_requirement_of_each_extra(requirement):
    assert CONSTRAINTS[canonicalize_name(requirement.name)][0] in requirement.specifier


def test_every_release_of_the_lock_has_hashes():
    sha256 = re.compile(r"sha256:[0-9a-f]{64}")
    without = [n for n, (_, h) in LOCK.items() if not h or not all(map(sha256.fullmatch, h))]
    assert LOCK
    assert without == []


def test_the_lock_and_the_constraints_have_the_same_versions():
    versions = {name: version for name, (version, _) in CONSTRAINTS.items()}
    assert {name: version for name, (version, _) in LOCK.items()}.items() <= versions.items()


def test_torch_is_pinned_without_a_hash_and_what_it_needs_beside_cuda_has_one():
    assert "torch" not in LOCK
    assert re.fullmatch(r"\d+\.\d+\.\d+", CONSTRAINTS["torch"][0])
    needs = {canonicalize_name(Requirement(text).name) for text in requires("torch")
             if "extra ==" not in text}  # fmt: skip
    assert {name for name in needs if not CUDA.match(name)} <= set(LOCK)
    assert [name for name in {**LOCK, **CONSTRAINTS} if CUDA.match(name)] == []


@pytest.mark.parametrize("file", ["requirements.lock", "constraints.txt"])
def test_no_pin_says_where_it_comes_from(file):
    assert (
        re.findall(r"://|--(?:extra-)?index-url|--find-links|@ ", (ROOT / file).read_text()) == []
    )


def test_make_installs_nothing_without_a_hash_but_torch():
    make = ["make", "--dry-run", "--always-make", ".venv/.installed", "WHEEL_INDEX=file:///wheels"]
    told = subprocess.run(make, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    hashed, torch, project = re.findall(r"pip .*\binstall (.*)", told)
    assert {"--require-hashes", "requirements.lock"} <= set(hashed.split())
    assert torch == "--constraint constraints.txt --extra-index-url file:///wheels torch"
    assert {"--no-deps", "--no-build-isolation"} <= set(project.split())


def test_the_citation_is_of_this_version_and_licence():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["version"] == PROJECT["version"] == wakedeploy.__version__
    assert cited["license"] == PROJECT["license"]
    assert [author["name"] for author in cited["authors"]] == [
        author["name"] for author in PROJECT["authors"]
    ]


def test_the_change_log_begins_with_what_is_not_released_and_has_this_version():
    heads = re.findall(r"^## \[(.+?)\](.*)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert heads[0] == ("Unreleased", "")
    assert wakedeploy.__version__ in [version for version, _ in heads]
    assert all(re.fullmatch(r" - \d{4}-\d{2}-\d{2}", date) for _, date in heads[1:])


def test_ci_runs_the_checks_on_every_python_that_is_supported():
    (job,) = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"].values()
    supported = [
        version.rpartition(" ")[2]
        for version in PROJECT["classifiers"]
        if re.search(r":: \d\.\d+$", version)
    ]
    assert job["strategy"]["matrix"]["python"] == supported
    assert job["steps"][-1]["run"] == "bash .ci/run"


def test_what_the_guide_for_contributors_names_is_there():
    guide = (ROOT / "CONTRIBUTING.md").read_text()
    named = [*re.findall(r"`((?:\w+/)+[\w.]*)`", guide), *re.findall(r"\]\(([^)#]+)", guide)]
    paths = [path for path in named if not re.search("NAME|STAGE|^build/", path)]
    assert len(paths) > 12
    assert [path for path in paths if not (ROOT / path).exists()] == []
    asked = set(re.findall(r"(?:^|`)make ([a-z]+)", guide, re.MULTILINE))
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert {"venv", "lock", "results"} <= asked <= set(targets)
    assert len(guide.splitlines()) < 90
