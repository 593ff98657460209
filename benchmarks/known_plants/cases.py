"""The cases: what is hidden in which plant, and which names would be right.

A name is right too where it means the same thing under another port. Nothing here was chosen by
what the workflow answers.
"""

from dataclasses import dataclass, field

from benchmarks.known_plants.plants import Hidden


@dataclass(frozen=True)
class Case:
    """`expected` are right names, of which one has to be said; `further` may be said beside.

    Where something is hidden and nothing expected, no effect has it: unknown is right.
    """

    plant: str
    drive: str
    hidden: Hidden = field(default_factory=dict)
    expected: tuple[str, ...] = ()
    further: tuple[str, ...] = ()
    coloured: bool = False
    seed: int = 0

    @property
    def name(self) -> str:
        """For a person."""
        what = "+".join(self.hidden) or "nothing"
        return f"{self.plant}, {self.drive}, {what}, {'coloured' if self.coloured else 'white'}"


def _dry(port: str) -> tuple[str, ...]:
    return f"coulomb-friction@{port}", f"pre-sliding-friction@{port}"


def _dry_and_more(port: str) -> tuple[str, ...]:
    return tuple(f"{k}-friction@{port}" for k in ("coulomb", "stribeck", "pre-sliding", "viscous"))


_CART, _SWING, _LOAD = "speed_mps", "speed_radps", "load_radps"
_HIDDEN = (
    ("cart", {"coulomb": 1.0}, _dry(_CART), ()),
    ("cart", {"coulomb": 0.7, "stribeck": 0.8, "fast": 0.1}, _dry_and_more(_CART), ()),
    ("cart", {"delay": 0.03}, ("dead-time@force_n",), ()),
    ("cart", {"band": 1.0}, ("dead-band@force_n",), ()),
    ("swing", {"coulomb": 0.15}, _dry(_SWING), ()),
    ("swing", {"viscous": 0.1}, (f"viscous-friction@{_SWING}",), ()),
    ("swing", {"drag": 0.03}, (f"quadratic-drag@{_SWING}",), ()),
    ("two masses", {"coulomb": 0.15, "still": 0.05}, _dry(_LOAD), ()),
    ("two masses", {"delay": 0.01}, ("dead-time@torque_nm",), ()),
    ("tank", {"leak": 0.002}, ("offset@level_m", "bias@pump"), ()),
    ("tank", {"rim": 0.5}, ("upper-stop@level_m",), ()),
    ("motor", {"delay": 0.04}, ("dead-time@voltage_v",), ()),
    ("motor", {"lag": 0.06}, ("lag@voltage_v",), ()),
    ("motor", {"most": 6.0}, ("saturation@voltage_v",), ()),
    ("motor", {"drag": 5e-5}, ("quadratic-drag@speed_radps",), ()),
    ("servo", {"play": 0.06}, ("backlash@command_rad",), ()),
    ("servo", {"delay": 0.06}, ("dead-time@command_rad",), ()),
    ("servo", {"weight": 20.0}, ("gravity@speed_radps", "stiffness@speed_radps"), ()),
    ("servo", {"coulomb": 8.0, "still": 0.02}, _dry(_SWING), ()),
    ("servo", {"sensor lag": 0.06}, ("sensor-lag@angle_rad", "sensor-dead-time@angle_rad"), ()),
    ("swing", {"wall": 0.5, "bounce": 0.2}, (f"upper-stop@{_SWING}",), ()),
    ("servo", {"wall": 0.4, "bounce": 0.5}, (f"upper-stop@{_SWING}",), ()),
    # Kinds of the library that none of those is; added later.
    ("cart", {"hold_s": 0.06}, ("sample-and-hold@force_n",), ()),
    ("cart", {"slew_per_s": 60.0}, ("rate-limit@force_n",), ()),
    ("cart", {"grain": 4.0}, ("quantisation@force_n",), ()),
    ("motor", {"uneven": 0.1}, ("asymmetry@voltage_v",), ()),
    ("motor", {"rings_radps": 15.0, "damping": 0.4}, ("second-order-lag@voltage_v",), ()),
    ("motor", {"clip": 35.0}, ("sensor-saturation@speed_radps",), ()),
    ("tank", {"clip": 0.55}, ("sensor-saturation@level_m",), ()),
    ("servo", {"blind below": -0.3}, ("sensor-floor@angle_rad",), ()),
    ("swing", {"sensor drift per s": 0.01}, ("sensor-drift@angle_rad",), ()),
    ("swing", {"sensor bias": 0.05}, ("sensor-bias@angle_rad", f"offset@{_SWING}"), ()),
    ("cart", {"spring": 6.0}, (f"stiffness@{_CART}",), ()),
    ("cart", {"cubic": 12.0}, (f"cubic-stiffness@{_CART}",), ()),
    ("cart", {"teeth": 1.0, "pitch_m": 0.2}, (f"periodic-force@{_CART}",), ()),
    ("cart", {"bristle": 1.5, "bends_m": 0.1},
     (f"hysteresis@{_CART}", f"pre-sliding-friction@{_CART}"), (f"coulomb-friction@{_CART}",)),
    ("servo", {"floor": -0.4, "bounce": 0.3}, (f"lower-stop@{_SWING}",), ()),
    ("cart", {"spring": 6.0, "rests_m": 0.5}, (f"preloaded-spring@{_CART}",), ()),
)  # fmt: skip
_OUTSIDE = (("cart", {"magnet": 4.0}), ("motor", {"shaking": 0.1}))
_OPEN = ("steps", "waves", "sweep")
_CONTROLLED = ("cart", "swing", "motor")


def _drives(plant: str) -> tuple[str, ...]:
    return (*_OPEN, "closed") if plant in _CONTROLLED else _OPEN


def _with_hidden() -> list[Case]:
    """Each effect twice, under other drives, once with a coloured sensor."""
    found = []
    for k, (plant, hidden, expected, further) in enumerate(_HIDDEN):
        drives = _drives(plant)
        for again in (0, 1):
            drive = drives[(k + 2 * again + k // 4) % len(drives)]
            found.append(
                Case(plant, drive, hidden, expected, further, bool(again), 100 * k + again)
            )
    return found


def _outside() -> list[Case]:
    """Laws that no effect of the library has, under two drives."""
    return [
        Case(plant, drive, hidden, coloured=bool(again), seed=5000 + 100 * k + again)
        for k, (plant, hidden) in enumerate(_OUTSIDE)
        for again, drive in enumerate(("steps", "closed"))
    ]


def _without() -> list[Case]:
    """Every plant under every drive, with nothing hidden."""
    plants = tuple(dict.fromkeys(hidden_case[0] for hidden_case in _HIDDEN))
    return [
        Case(plant, drive, coloured=bool((i + j) % 2), seed=7000 + 100 * i + j)
        for i, plant in enumerate(plants)
        for j, drive in enumerate(_drives(plant))
    ]


CASES = (*_with_hidden(), *_outside(), *_without())
