"""What a system does along a recording, beside what was measured there."""

from collections.abc import Mapping

from wakedeploy.gap.evidence.fits import FloatArray


class Replay(dict[str, FloatArray]):
    """States and outputs by name, (n,) each at the system's rate.

    `time_s` (n,) has the recording's times of these samples, and `measured` what it shows there of
    each output, (n,), NaN where nothing was measured.
    """

    def __init__(
        self,
        series: Mapping[str, FloatArray],
        time_s: FloatArray,
        measured: Mapping[str, FloatArray],
    ) -> None:
        super().__init__(series)
        self.time_s = time_s
        self.measured = measured
