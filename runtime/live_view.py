"""What a live page gets of a run beside its rows: the rig, in the few numbers that a page draws.

In: a request, a rig. Out: plain dictionaries. The rows go through `runtime.io.live_feed`.
"""

from pathlib import Path
from typing import Any

from runtime.loop.loop import PERIOD_S, budget_s
from runtime.request import RunRequest
from wakedeploy.core.failsafes import hints
from wakedeploy.core.rig import Rig


def rig_view(rig: Rig) -> dict[str, Any]:
    """The numbers of a rig that a page draws with; lengths in m, times in s, forces in N."""
    return {
        "source_height_m": rig.source.height_m,
        "travel_m": rig.sufferer.travel_m,
        "rotor_radius_m": rig.sufferer.rotor_radius_m,
        "x_limits_m": list(rig.limits.x_m),
        "z_limits_m": list(rig.limits.z_m),
        "wake_mps": rig.wake.speed_mps,
        "wake_width_m": rig.wake.width_m,
        "wake_diffusivity_m2ps": rig.wake.diffusivity_m2ps,
        "wake_decay_per_s": rig.wake.decay_per_s,
        "source_pulse_us": list(rig.thrust.source.pulse_us),
        "source_thrust_n": list(rig.thrust.source.thrust_n),
        "sufferer_pulse_us": list(rig.thrust.sufferer.pulse_us),
        "sufferer_thrust_n": list(rig.thrust.sufferer.thrust_n),
        "period_s": PERIOD_S,
        "budget_s": budget_s(rig),
    }


def run_view(request: RunRequest, log: Path | None) -> dict[str, Any]:
    """What is flown, on what, and where it is recorded ("": nowhere)."""
    package = "PID alone" if request.package is None else request.package.name
    place = "virtual gantry" if request.is_virtual else str(request.port)
    return {
        "rig": rig_view(request.rig),
        "title": f"{package} on the {place}" if request.is_virtual else f"{package} at {place}",
        "log": "" if log is None else str(log),
        "watches_gap": request.watch_gap,
        "hints": hints(is_virtual=request.is_virtual),
    }
