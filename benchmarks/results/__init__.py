"""The pages of results, each made from records alone: `python -m benchmarks.results`.

In: `docs/records/`. Out: `docs/results.md`, the pages in `docs/results/`, the table in README.md,
and the pictures that are drawn from records. A section of a page is one function that takes the
records that it asks for and returns a `Section`; its place is in `pages.CHAPTERS`.
"""
