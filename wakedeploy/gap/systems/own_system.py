"""A system as its user writes it, which replays recordings and takes corrections.

In: a class of about twenty lines, derived from `System`. Out: replays along recordings. `system`
says what such a class states and calls its functions; `files` reads one from a file, `checks`
tries it.
"""

from pathlib import Path
from typing import Self

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import path_from
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.checks import checked, require_sound
from wakedeploy.gap.systems.correction import read_correction
from wakedeploy.gap.systems.replay import Replay
from wakedeploy.gap.systems.system import StateSpace


class System(StateSpace):
    """Derive from it, and state what the class attributes ask for.

    `derivative(state, inputs, c)` returns the derivative of every state by name, or
    `step(state, inputs, c)` the states one sample later. `measure(state, inputs, c)` is needed for
    outputs that are not states; `start(measured)` for states that the first samples do not give:
    it is called with the first measured values and returns states by name.
    `derivative_under(state, inputs, c, forces)` is for a mechanism in which a force at one state's
    port moves others too; `forces` are by the ports' states, as `forces.speed_mps`, and 0 where
    nothing acts. Without it a force moves its own state, or what the input moves that its port says
    it is `like`.
    `steps` are those of the model within a sample, which a system needs that is fast against
    `rate_hz`; inputs are then taken between the samples, as they hold.
    `process_noise` and `start_spread` override the library's guesses for states, by name; a
    process noise of 0 is none, and stays none. What a `step` only remembers has none by itself, nor
    a correction of its form, if nothing is stated and no force acts there. `outlier_share` of the
    samples may be outliers, `forecast_s` is how far ahead a forecast has to be right for an effect
    to matter. `costs_by_point` says that N points take about N times as long as one, as where a
    simulator is asked for each: a search then tries none that it may not need. `exported` names
    the files that an `export` of your own writes: those of an earlier answer are then removed.

    Values are in the units that the class states; each is a number, or (N,) where N points are
    tried at once. What does not fit raises UnusableInput by the name of method, state and point.
    """

    @classmethod
    def corrected(cls, path: str | Path) -> Self:
        """The system with what `gap add` has written, which `simulate` then applies.

        Raises UnusableInput for a file that cannot be read or corrects another system.
        """
        found = checked(cls())
        found.correction = read_correction(path_from(path, "path"), found.name)
        return found

    def simulate(self, recording: Recording) -> Replay:
        """Every state and output along a recording's inputs, each (n,) at the system's rate.

        They are by name, as in a dict. A recording may be finer than the system: `time_s` (n,) of
        what is returned says when, and `measured` what the recording shows then. The replay starts
        where the recording does, or so much later that its readings count in time, and sees no
        measurement afterwards. Raises UnusableInput for what is no recording, or lacks a column,
        and for a system in which something does not fit.
        """
        if not isinstance(recording, Recording):
            raise UnusableInput(
                f"{type(self).__name__}.simulate takes one Recording, not a "
                f"{type(recording).__name__}; wakedeploy.read_log gives all that a log holds."
            )
        from wakedeploy.gap.systems.late_readings import in_time  # takes a second to load
        from wakedeploy.gap.systems.simulation import simulated

        require_sound(self)  # each time: what it states may have been changed since
        return simulated(self, in_time(self, recording))
