"""Write every generated page and picture of results: `python -m benchmarks.results`."""

from benchmarks import records, tuned
from benchmarks.hidden_effects.page import draw
from benchmarks.hidden_effects.table import summary
from benchmarks.results import so101
from benchmarks.results.pages import Pages
from benchmarks.results.section import Records
from wakedeploy.core import figures
from wakedeploy.core.files import write_text_whole


def main() -> None:
    """Make all from the records."""
    for path, text in Pages().texts.items():
        write_text_whole(records.ROOT / path, text)
        print(path)
    read = Records(records.FOLDER)
    rows = read.json("tuned.json")["rows"]
    for name, drawn in (
        ("tuned-gain", tuned.gains(rows)),
        ("tuned-importances", tuned.importances(rows)),
        ("gap-benchmark", draw(summary(read.lines("gap-benchmark.jsonl")))),
    ):
        figures.save(drawn, records.FIGURES / f"{name}.png")
    if (records.FOLDER / so101.RECORD).exists():
        arm = so101.drawn(read.json(so101.RECORD))
        figures.save(arm, records.FIGURES / f"{so101.FIGURE}.png")


if __name__ == "__main__":
    main()
