"""The pages of results: which sections there are, in which order, and what stands around them."""

from collections.abc import Callable
from pathlib import Path

from benchmarks import downwash_estimates, records, tuned
from benchmarks.hidden_effects.page import markdown_of
from benchmarks.hidden_effects.table import summary
from benchmarks.results import (
    comparison,
    compiled,
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
    simulators,
    so101,
    studies,
    study_claims,
    tutorials,
)
from benchmarks.results.section import Records, Section, paragraphs

SECTIONS: dict[str, tuple[Callable[[Records], Section], ...]] = {
    "In flight": (
        flight.demo,
        first_minutes.first_minutes,
        flight.tracking,
        flight.latency,
        flight.endings,
        flight.watch,
        flight.soak,
        *((live.live,) if (records.FOLDER / live.RECORD).exists() else ()),
        faults.faults,
    ),
    "On a chip": (
        compiled.on_a_chip,
        compiled.against_error,
        compiled.on_this_machine,
        compiled.paced,
        compiled.on_an_avr,
    ),
    "Training": (learning.training, learning.flag, learning.speed, learning.tuned),
    "The paper's comparisons": (
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
    "Finding what the simulation lacks": (
        gap.demo,
        gap.hidden_effects,
        gap.form_losses,
        *((gap.form_error,) if (records.FOLDER / gap.FORM_ERROR).exists() else ()),
        *(
            (reference_flights.learned,)
            if (records.FOLDER / reference_flights.RECORD).exists()
            else ()
        ),
        gap.power,
        gap_domains.domains,
        *((real_systems.named,) if (records.FOLDER / real_systems.RECORD).exists() else ()),
        *((known_plants.counted,) if (records.FOLDER / known_plants.RECORD).exists() else ()),
        *((comparison.compared,) if (records.FOLDER / comparison.RECORD).exists() else ()),
        *((so101.joints,) if (records.FOLDER / so101.RECORD).exists() else ()),
    ),
    "Simulators and firmware": (
        simulators.downwash_speed,
        simulators.field_step,
        simulators.estimates,
        simulators.firmware_size,
        simulators.mutants,
        simulators.frames,
    ),
    # Half an hour of disturbed commands: its section is there once it has been made.
    "Robustness": (
        *((interrupted.interrupted,) if (records.FOLDER / interrupted.RECORD).exists() else ()),
        hostile.files,
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
        self.texts = {f"docs/results/{name}": self._detail(of) for name, of in DETAILS.items()}
        self.texts["docs/results.md"] = self._results()
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

    def _results(self) -> str:
        parts = [
            "# Results",
            "`make results` makes this page from the [records](records/). Each section says what "
            "was measured, which commands make it again, and when and at which commit the record "
            "was made. No number here is written by hand.",
        ]
        for chapter, sections in SECTIONS.items():
            parts += [f"## {chapter}", *(self._section(section) for section in sections)]
        return paragraphs(*parts) + "\n"

    def _section(self, make: Callable[[Records], Section]) -> str:
        read = self._read()
        section = make(read)
        commands = "\n".join(("```sh", *section.commands, "```"))
        return paragraphs(
            f"### {section.title}",
            section.measured,
            section.body,
            commands,
            self._provenance(read, "records"),
        )

    def _detail(self, make: Callable[[Records], str]) -> str:
        read = self._read()
        return paragraphs(make(read), self._provenance(read, "../records")) + "\n"

    def _read(self) -> Records:
        return Records(self.folder)

    def _provenance(self, read: Records, place: str) -> str:
        """When and at which commit the records of a section were made."""
        self.used |= set(read.read)
        sources = [
            f"measured {stamp.day} at {_commits(stamp.commit)}{_on(stamp.machine)}: "
            + ", ".join(f"[{name}]({place}/{name})" for name in names)
            for stamp, names in read.stamps().items()
        ]
        return "Records " + "; ".join(sources) + "."


def _commits(commit: str) -> str:
    return ", ".join(f"`{revision}`" for revision in commit.split(", ")) if commit else "no commit"


def _on(machine: str) -> str:
    return f" on {machine}" if machine else ""
