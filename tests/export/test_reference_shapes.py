"""The reference shapes of Table I as packages that the bench can fly."""

import pytest

pytest.importorskip("torch")

from export import reference
from wakedeploy.package import read_package


def test_reference_packages_have_the_tables_shapes_and_pass_the_parity_gate(tmp_path, monkeypatch):
    few = ("agile-mlp", "gru", "esn")
    monkeypatch.setattr(reference, "ARCHITECTURES", few)
    manifests = [read_package(p).manifest for p in reference.write_reference_packages(tmp_path)]
    assert [m.arch for m in manifests] == list(few)
    assert [(m.trainable, m.frozen) for m in manifests] == [
        (17_922, 0), (70_882, 0), (2_002, 1_008_000),
    ]  # fmt: skip
    assert all(m.parity.passed for m in manifests)


def test_the_window_of_the_reference_shapes_has_31_snapshots():
    from trainers.runs import new_predictor

    predictor = new_predictor(reference.reference_config("history-mlp"))
    assert (predictor.memory.k, predictor.memory.stride) == (31, 1)
