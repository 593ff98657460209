"""Whether every library that wakedeploy needs on a Raspberry Pi is there as a wheel for it.

Asks the package index that pip is set up for, for each Python that wakedeploy supports, which wheel
a 64-bit Raspberry Pi OS would take: the base install with [onnx] at the versions of
constraints.txt, and the extra [rig], transitively, each requirement's markers judged as on the Pi.
Prints a table; exit status 1 when a library of the base install or of [onnx] has no wheel. What
[rig] lacks is told and does not count: pip builds it on the Pi, which needs a compiler and
python3-dev.

    python deployment/aarch64_wheels.py
"""

import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PYTHONS = ("3.11", "3.12", "3.13")
GLIBC = 36  # Raspberry Pi OS 12 (bookworm) has glibc 2.36
NO_WHEEL = ("No matching distribution", "ResolutionImpossible")  # the latter under a constraint
PLATFORMS = ("manylinux2014_aarch64", *(f"manylinux_2_{n}_aarch64" for n in range(17, GLIBC + 1)))

Answer = tuple[str, list[str]]  # a wheel's name, and what it requires


@dataclass
class Found:
    """What one Python on the Pi gets: the wheel of each library (None: there is none), by name."""

    python: str
    wheels: dict[str, str | None] = field(default_factory=dict)
    rig_only: set[str] = field(default_factory=set)

    def missing(self) -> list[str]:
        """Libraries of the base install and of [onnx] without a wheel."""
        return [n for n, wheel in self.wheels.items() if wheel is None and n not in self.rig_only]


def on_the_pi(python: str, extra: str = "") -> dict[str, str]:
    """The environment in which a Pi judges markers."""
    return {
        "implementation_name": "cpython",
        "implementation_version": f"{python}.2",
        "os_name": "posix",
        "platform_machine": "aarch64",
        "platform_python_implementation": "CPython",
        "platform_release": "6.12.0",
        "platform_system": "Linux",
        "platform_version": "1",
        "python_full_version": f"{python}.2",
        "python_version": python,
        "sys_platform": "linux",
        "extra": extra,
    }


def look(requirements: list[Requirement], python: str, constraints: Path) -> dict[str, Answer]:
    """What pip would take for these, by name; without those that have no wheel."""
    platforms = [word for name in PLATFORMS for word in ("--platform", name)]
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        asked = subprocess.run(
            [
                sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--no-deps",
                "--disable-pip-version-check", "--ignore-installed", "--target", folder,
                "--only-binary", ":all:", "--python-version", python, "--implementation", "cp",
                *platforms, "--constraint", constraints, "--report", report,
                *(f"{r.name}{r.specifier}" for r in requirements),
            ],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        if asked.returncode == 0:
            installed = json.loads(report.read_text())["install"]
        elif not any(words in asked.stderr for words in NO_WHEEL):
            raise SystemExit(f"pip cannot ask its index: {asked.stderr.strip()}")
        elif len(requirements) == 1:
            return {}
        else:  # one of them has none: ask for each
            answers = [look([requirement], python, constraints) for requirement in requirements]
            return {name: answer for each in answers for name, answer in each.items()}
    return {
        canonicalize_name(package["metadata"]["name"]): (
            Path(package["download_info"]["url"]).name,
            package["metadata"].get("requires_dist", []),
        )
        for package in installed
    }


def follow(found: Found, wanted: list[str], constraints: Path, *, rig: bool) -> None:
    """Look for these requirements and, in turn, for theirs."""
    pending = [Requirement(text) for text in wanted]
    while pending:
        asked = {canonicalize_name(r.name): r for r in pending}
        asked = {name: r for name, r in asked.items() if name not in found.wheels}
        answers = look(list(asked.values()), found.python, constraints) if asked else {}
        pending = []
        for name, requirement in asked.items():
            wheel, requires = answers.get(name, (None, []))
            found.wheels[name] = wheel
            found.rig_only |= {name} if rig else set()
            pending += applying(requires, requirement.extras, found.python)


def applying(requires: list[str], extras: set[str], python: str) -> list[Requirement]:
    """Those of a library's requirements that hold on the Pi, with these extras of it."""
    environments = [on_the_pi(python, extra) for extra in ("", *extras)]
    parsed = [Requirement(text) for text in requires]
    return [r for r in parsed if not r.marker or any(map(r.marker.evaluate, environments))]


def search(python: str) -> Found:
    """All wheels for one Python."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    found, constraints = Found(python), ROOT / "constraints.txt"
    extras = project["optional-dependencies"]
    follow(found, project["dependencies"] + extras["onnx"], constraints, rig=False)
    follow(found, extras["rig"], constraints, rig=True)
    return found


def main() -> int:
    """Search, print, judge."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--python", choices=PYTHONS, action="append", help="Default: all three.")
    arguments = parser.parse_args()
    missing = []
    for python in arguments.python or PYTHONS:
        found = search(python)
        print(f"Python {python}")
        for name, wheel in sorted(found.wheels.items(), key=lambda w: (w[0] in found.rig_only, w)):
            group = "rig " if name in found.rig_only else "base"
            print(f"  {group}  {name:40} {wheel or 'NO WHEEL'}")
        missing += [f"{name} (Python {python})" for name in found.missing()]
        without = [n for n in found.rig_only if found.wheels[n] is None]
        count = sum(wheel is not None for wheel in found.wheels.values())
        print(
            f"  {count} wheels; of [rig] to be built there: {', '.join(sorted(without)) or '-'}\n"
        )
    if missing:
        print(f"No wheel for aarch64, if pip reaches its index: {', '.join(missing)}")
        return 1
    print("Every library of the base install and of [onnx] has a wheel for aarch64.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
