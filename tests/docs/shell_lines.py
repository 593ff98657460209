"""The shell commands of the pages: which there are, how each is read, and how it runs small.

A block that holds commands begins with ```sh, any other with another word. A comment
`<!-- file: NAME -->` before another block makes its text a file beside the commands.
"""

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
STANDS_FOR = "stands here on the site."  # of a page that is a file elsewhere
PAGES = (
    ROOT / "README.md",
    *(
        page
        for page in sorted((ROOT / "docs").rglob("*.md"))
        if STANDS_FOR not in page.read_text("utf-8")
    ),
)
FENCE = re.compile(
    r"(?:<!-- file: (?P<file>\S+) -->\n+)?^ *```(?P<word>\S*)(?: [a-z_]+)?\n(?P<body>.*?)^ *```$",
    re.MULTILINE | re.DOTALL,
)

# What the small runs change: sizes, the port, and what not every machine allows.
SMALLER = (
    (r"--minutes \d+", "--minutes 2"),
    (r"--seeds \d+", "--seeds 1"),
    (r"--arch all", "--arch agile-mlp,gru"),
    (r"--trials \d+", "--trials 2 --epochs 1"),
    (r"--flights \d+ --seconds \d+", "--flights 4 --seconds 8"),
    (r"--virtual --flights \d+", "--virtual --flights 2 --seconds 6"),
    (r"--virtual --seconds \d+", "--virtual --seconds 10"),  # `log smooth` wants 7 s in the air
    (r"--epochs \d+", "--epochs 1"),
    (r"^wakedeploy train ", "wakedeploy train --epochs 1 "),
    (r"^wakedeploy demo", "wakedeploy demo --minutes 4 --seconds 10"),
    (r"^wakedeploy gap demo", "wakedeploy gap demo --quick"),
    (r"(wakedeploy calibrate .*)--port \S+", r"\1--virtual --out desk.toml"),
    (r"--port \S+", "--virtual"),
    (r" --realtime", ""),
    (r"^(wakedeploy run-gantry (?!.*--(?:seconds|reference)).*--virtual.*)$", r"\1 --seconds 10"),
)

# Commands of ours that are read, and not run here: a pattern of page and command, and why.
NOT_RUN = {
    r"^docs/tutorials/(at|own|mujoco)-": "takes minutes; test_tutorials.py obeys it as it stands",
    r"^docs/results": "makes a record: takes minutes to hours",
    r" (data import (?!table)|study .*--recordings|gap domain \w+ PATH)": "needs public recordings",
    r" study ": "takes minutes to hours; tests/study run the studies on a few episodes",
    r" --mjcf ": "needs a MuJoCo model; tests/gap/systems/test_mjcf.py makes one",
    r" gap domain downwash": "takes minutes; tests/gap/domains run it on short flights",
    r" gap follow ": "needs a class that is open; test_follow_up.py has one",
    r" (gap reference |--rig reference/)": "needs ordinary flights; test_learning.py flies some",
    r" --from-symbolic": "needs a gap that no effect explains; tests/gap add one",
    r" deploy ": "needs a Pi; tests/deployment deploy to an ssh server of their own",
    r" (--live|--foxglove|live \S|log browse)": "serves until it is stopped; tests/live do it",
    r" (rig virtual|.* --range-socket|log show desk\.mcap)": "takes real time; test_port_page.py"
    " obeys both terminals",
    r" --firmware": "needs the AVR compiler; tests/firmware fly the sketch on a simulated chip",
    r" (.* --wall-clock|bench latency)": "needs a quiet machine; the tests marked wallclock do it",
    r" --install-completion": "writes into the home; tests/cli/test_completion.py has one to give",
    r" (--storage|--scheduler) ": "needs a database or a cluster, as in tests/cli and tests/sweep",
}
# Lines of other programs: the first word, and why they are not run.
OTHERS = {
    "sudo": "changes the system",
    "scp": "needs a Pi",
    "ssh": "needs a Pi",
    "ssh-copy-id": "needs a Pi",
    "git": "sends the checkout to a Pi, as test_rig_page.py does to a folder, or makes another",
    "cd": "of a line that needs a Pi, or hours",
    "printf": "changes the system",
    "mkdir": "of a line that needs a Pi",
    "touch": "needs the service",
    "systemd-analyze": "needs the service; tests/deployment ask it about the unit file",
    ".": "enters the environment",
    "eval": "is for an interactive shell; test_commands.py gives it to one",
    "pytest": "is the test suite itself",
    "cat": "shows a file that the line before it wrote",
    "head": "shows a file that the line before it wrote",
    "tail": "shows a file that the line before it wrote",
    "grep": "shows a file that the line before it wrote",
    "make": "installs, measures or takes minutes: `make --dry-run` reads it",
    "python": "measures for hours or changes the checkout: its options are read",
}
# What takes longer than a second or two even when it is small: the slow tests run it.
SLOW = r"^docs/how-to/rig.md| (demo|tune|sweep|calibrate|bench lead)\b"
SLOW += r"| gap (close|find|name|add|show|power|plan|demo) | data make (downwash|ship) "
SLOW += r"| --preset tuned/| --reference fly.csv"


@dataclass(frozen=True)
class Line:
    """A command of a page."""

    page: str
    number: int
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.number}: {self.text}"

    @property
    def is_ours(self) -> bool:
        return self.text.startswith("wakedeploy ")

    @property
    def not_run_because(self) -> str | None:
        """Why it is read only; None where it is run."""
        if not self.is_ours:
            return OTHERS.get(shlex.split(self.text)[0])
        told = f"{self.page} {self.text}"
        return next((why for what, why in NOT_RUN.items() if re.search(what, told)), None)

    @property
    def is_slow(self) -> bool:
        return re.search(SLOW, f"{self.page} {self.text}") is not None

    def small(self) -> str:
        """The command as it is run here."""
        text = self.text
        for what, instead in SMALLER:
            text = re.sub(what, instead, text)
        return text


def fences(page: Path) -> Iterator[tuple[str, str | None, str, int]]:
    """Each fenced block: its word, the file it makes, its text and its first line's number."""
    text = page.read_text("utf-8")
    for found in FENCE.finditer(text):
        number = text[: found.start("body")].count("\n") + 1
        yield found["word"], found["file"], found["body"], number


def lines(page: Path) -> list[Line]:
    """The commands of a page, continued lines joined, comments gone."""
    name, told = str(page.relative_to(ROOT)), []
    for word, _, body, number in fences(page):
        if word != "sh":
            continue
        whole = re.sub(r"\\\n\s*", lambda joined: " " * len(joined[0]), body)
        for at, text in enumerate(whole.splitlines()):
            bare = re.sub(r"\s+# .*$", "", text).strip()
            if bare:
                told.append(Line(name, number + at, bare))
    return told


def files(page: Path) -> dict[str, str]:
    """The files that a page shows."""
    return {file: body for _, file, body, _ in fences(page) if file}


ALL = [line for page in PAGES for line in lines(page)]
