"""From a trained predictor to one checked .onnx file.

In: a `trainers.model.Predictor` with its run's configuration, and episodes to prove parity on.
Out: a package (`wakedeploy.core.package`), or CheckFailed and no file at all. May import trainers,
runtime (parity is measured with the runner that ships) and the ground.
"""
