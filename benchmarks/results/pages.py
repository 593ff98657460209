"""The pages of results: which sections there are, in which order, and what stands around them."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from benchmarks import downwash_estimates, records, tuned
from benchmarks.hidden_effects.page import markdown_of
from benchmarks.hidden_effects.table import summary
from benchmarks.results import (
    between,
    comparison,
    compiled,
    coverage,
    effects,
    faults,
    first_minutes,
    flight,
    flown,
    gap,
    gap_domains,
    hostile,
    interrupted,
    known_plants,
    learning,
    live,
    readme,
    real_systems,
    reference_flights,
    silent,
    simulators,
    so101,
    studies,
    study_claims,
    tutorials,
)
from benchmarks.results.section import Records, Section, anchor, paragraphs

Make = Callable[[Records], Section]


class Chapter(NamedTuple):
    """A page of sections: its title, and what makes each section."""

    title: str
    sections: tuple[Make, ...]


def _of_record(name: str, make: Make) -> tuple[Make, ...]:
    """A section whose record takes hours: it is there once that has been made."""
    return (make,) if (records.FOLDER / name).exists() else ()


CHAPTERS: dict[str, Chapter] = {  # by the name of the page in docs/results/
    "in-flight": Chapter(
        "In flight",
        (
            flight.demo,
            first_minutes.first_minutes,
            flight.tracking,
            flight.latency,
            flight.watch,
            flight.soak,
            *_of_record(live.RECORD, live.live),
        ),
    ),
    "safety": Chapter(
        "When something goes wrong",
        (
            flight.endings,
            faults.faults,
            *_of_record(interrupted.RECORD, interrupted.interrupted),
            hostile.files,
        ),
    ),
    "chip": Chapter(
        "On a chip",
        (
            compiled.on_a_chip,
            compiled.against_error,
            compiled.on_this_machine,
            compiled.paced,
            compiled.on_an_avr,
        ),
    ),
    "training": Chapter(
        "Training", (learning.training, learning.flag, learning.speed, learning.tuned)
    ),
    "comparisons": Chapter(
        "The paper's comparisons",
        (
            studies.domains,
            studies.kinds,
            flown.closed_loop,
            flown.shift,
            flown.lead,
            studies.window,
            studies.pareto,
            studies.delay,
            studies.basin,
        ),
    ),
    "gap": Chapter(
        "Finding what the simulation lacks",
        (
            gap.demo,
            gap.hidden_effects,
            *_of_record(coverage.RECORD, coverage.held),
            gap.form_losses,
            *_of_record(gap.FORM_ERROR, gap.form_error),
            *_of_record(reference_flights.RECORD, reference_flights.learned),
            gap.power,
        ),
    ),
    "other-systems": Chapter(
        "Finding it in other systems",
        (
            gap_domains.domains,
            *_of_record(real_systems.RECORD, real_systems.named),
            *_of_record(between.RECORD, between.compared),
            *_of_record(silent.RECORD, silent.asked),
            *_of_record(known_plants.RECORD, known_plants.counted),
            *_of_record(comparison.RECORD, comparison.compared),
            *_of_record(so101.RECORD, so101.joints),
        ),
    ),
    "simulators": Chapter(
        "Simulators and firmware",
        (
            simulators.downwash_speed,
            simulators.field_step,
            simulators.estimates,
            simulators.firmware_size,
            simulators.mutants,
            simulators.frames,
        ),
    ),
}


def hidden_effects(read: Records) -> str:
    """The gap benchmark's page."""
    lines = "../records/gap-benchmark.jsonl"
    totals = summary(read.lines("gap-benchmark.jsonl"))
    return markdown_of(totals, "../figures/gap-benchmark.png", lines).strip()


def tuned_shapes(read: Records) -> str:
    """The page of tuned hyper-parameters."""
    return tuned.page(read.json("tuned.json")["rows"]).strip()


def estimates(read: Records) -> str:
    """The page of the 2D downwash's open constants."""
    result = read.json("downwash-estimates.json")
    worlds = {name: world for name, world in result.items() if isinstance(world, dict)}
    return downwash_estimates.page(worlds).strip()


DETAILS: dict[str, Callable[[Records], str]] = {
    "gap-benchmark.md": hidden_effects,
    "gap-domains.md": gap_domains.page,
    "studies.md": study_claims.page,
    "tuned.md": tuned_shapes,
    "downwash-estimates.md": estimates,
    "faults.md": faults.page,
}


class Pages:
    """All generated texts by their path from the root, and the records that they were made of."""

    def __init__(self, folder: Path = records.FOLDER) -> None:
        self.folder = folder
        self.used: set[str] = set()
        details = {name: self._detail(make) for name, make in DETAILS.items()}
        chapters = {f"{name}.md": self._chapter(each) for name, each in CHAPTERS.items()}
        self.texts = {f"docs/results/{name}": text for name, text in (details | chapters).items()}
        self.texts["docs/results.md"] = self._results(chapters, details)
        self.texts["README.md"] = readme.filled(
            (records.ROOT / "README.md").read_text("utf-8"), self._read()
        )
        manual = "docs/reference/effects.md"
        self.texts[manual] = effects.filled((records.ROOT / manual).read_text("utf-8"))
        for name in tutorials.PAGES:
            lesson = f"docs/tutorials/{name}.md"
            read = self._read()
            text = (records.ROOT / lesson).read_text("utf-8")
            self.texts[lesson] = tutorials.filled(name, text, read)
            self.used |= set(read.read)

    def _results(self, chapters: dict[str, str], details: dict[str, str]) -> str:
        """The first page: the figures that are asked for first, and where all others are."""
        listed = [
            f"- **[{_title(text)}](results/{name})**: "
            + "; ".join(
                f"[{_lower(title)}](results/{name}#{anchor(title)})" for title in _titles(text)
            )
            for name, text in chapters.items()
        ]
        parts = [
            "# Results",
            "Each table of these pages says what was measured, which commands make it again, and "
            "when and at which commit its record was made. `make results` makes the pages from "
            "the [records](records/). No number here is written by hand.",
            readme.results(self._read()),
            "## Pages",
            "\n".join(listed),
            "## In detail",
            "\n".join(f"- [{_title(text)}](results/{name})" for name, text in details.items()),
        ]
        return paragraphs(*parts) + "\n"

    def _chapter(self, chapter: Chapter) -> str:
        sections = (self._section(make) for make in chapter.sections)
        return paragraphs(f"# {chapter.title}", *sections) + "\n"

    def _section(self, make: Make) -> str:
        read = self._read()
        section = make(read)
        commands = "\n".join(("```sh", *section.commands, "```"))
        return paragraphs(
            f"## {section.title}",
            section.measured,
            section.body,
            commands,
            self._provenance(read),
        )

    def _detail(self, make: Callable[[Records], str]) -> str:
        read = self._read()
        return paragraphs(make(read), self._provenance(read)) + "\n"

    def _read(self) -> Records:
        return Records(self.folder)

    def _provenance(self, read: Records) -> str:
        """When and at which commit the records of a section were made."""
        self.used |= set(read.read)
        sources = [
            f"measured {stamp.day} at {_commits(stamp.commit)}{_on(stamp.machine)}: "
            + ", ".join(f"[{name}](../records/{name})" for name in names)
            for stamp, names in read.stamps().items()
        ]
        return "Records " + "; ".join(sources) + "."


def _commits(commit: str) -> str:
    return ", ".join(f"`{revision}`" for revision in commit.split(", ")) if commit else "no commit"


def _on(machine: str) -> str:
    return f" on {machine}" if machine else ""


def _title(page: str) -> str:
    return page.partition("\n")[0].removeprefix("# ")


def _titles(page: str) -> list[str]:
    return [line.removeprefix("## ") for line in page.splitlines() if line.startswith("## ")]


def _lower(title: str) -> str:
    """A title within a sentence; a single letter is a name, such as C, unless it is an article."""
    is_name = title[1:2] == " " and title[0] != "A"
    return title if is_name else title[:1].lower() + title[1:]
