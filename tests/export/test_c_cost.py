"""What C will take, told before it is compiled, against what was counted."""

import json
from pathlib import Path

import pytest

from export.c.cost import c_cost
from export.c.lowering import lowered
from trainers.build import ARCHITECTURES
from wakedeploy.core.onnx_graph import read_graph

RECORD = Path(__file__).parents[2] / "docs" / "records" / "compiled.json"


@pytest.fixture(scope="module")
def counted() -> dict[str, dict]:
    """By architecture: what the simulator counted for the reference shape."""
    sizes = json.loads(RECORD.read_text())["parts"]["sizes"]
    return {arch: one["float32"] for arch, one in sizes.items()}


@pytest.mark.whole
@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_instructions_are_estimated_within_a_twentieth(exported_arch, counted, arch):
    cost, found = c_cost(exported_arch(arch).package), counted[arch]
    assert cost.instructions == pytest.approx(found["instructions"], rel=0.05)
    assert cost.ram_bytes <= found["state"] + found["stack"] <= cost.ram_bytes + 600
    assert cost.flash_bytes < found["flash"] < cost.flash_bytes + 8000


@pytest.mark.whole
def test_a_wider_gru_takes_more_of_everything(monkeypatch):
    from export.c import trial_cost
    from export.reference import reference_config
    from trainers.training.runs import new_predictor

    exported, told = trial_cost._cost, []
    for hidden in (16, 32):
        config = reference_config("gru").model_copy(update={"hyper": {"hidden": hidden}})
        predictor = new_predictor(config).eval()
        cost = exported(predictor, config)  # once, not for each measure
        monkeypatch.setattr(trial_cost, "_cost", lambda *_, cost=cost: cost)
        told.append([of(predictor, config, None) for of in trial_cost.MEASURES.values()])
    assert all(small < large for small, large in zip(*told, strict=True))


def test_flash_is_that_of_the_constants(exported_arch):
    package = exported_arch("gru").package
    program = lowered(read_graph(package.model_bytes), package.manifest, "float32")
    weights = sum(m.weights.size for m in program.matrices)
    tables = sum(values.size for values in program.tables.values())
    assert program.weight_bytes("float32") == 4 * (weights + tables)
    assert program.weight_bytes("int8") < 0.3 * program.weight_bytes("float32")
