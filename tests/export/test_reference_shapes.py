"""The reference shapes of Table I as packages that the bench can fly."""

import pytest

pytest.importorskip("torch")

from export import reference
from wakedeploy.core.package import read_package

TABLE_I = {  # trainable, frozen
    "agile-mlp": (17_922, 0),
    "history-mlp": (48_642, 0),
    "delay-embedding": (35_014, 0),
    "gru": (70_882, 0),
    "tcn": (72_602, 0),
    "mamba": (8_802, 0),
    "esn": (2_002, 1_008_000),
    "cross-attention": (15_522, 0),
}


@pytest.mark.whole
def test_reference_packages_have_the_tables_shapes_and_pass_the_parity_gate(tmp_path, monkeypatch):
    few = ("agile-mlp", "delay-embedding")  # nothing starts at zero, and something does
    monkeypatch.setattr(reference, "ARCHITECTURES", few)
    manifests = [read_package(p).manifest for p in reference.write_reference_packages(tmp_path)]
    assert [m.arch for m in manifests] == list(few)
    assert [(m.trainable, m.frozen) for m in manifests] == [TABLE_I[m.arch] for m in manifests]
    assert all(m.parity.passed for m in manifests)


@pytest.mark.parametrize(("arch", "counts"), TABLE_I.items())
def test_a_package_states_the_tables_counts(arch, counts, exported_arch):
    manifest = read_package(exported_arch(arch).path).manifest
    assert (manifest.trainable, manifest.frozen) == counts


def test_the_window_of_the_reference_shapes_has_31_snapshots():
    from trainers.training.runs import new_predictor

    predictor = new_predictor(reference.reference_config("history-mlp"))
    assert (predictor.memory.k, predictor.memory.stride) == (31, 1)
