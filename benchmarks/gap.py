"""The gap workflow against hidden effects, as `wakedeploy gap benchmark` runs it.

python benchmarks/gap.py --workers 2 --page docs/gap-benchmark.md
"""

from wakedeploy.cli.gap_benchmark import benchmark

if __name__ == "__main__":
    benchmark()
