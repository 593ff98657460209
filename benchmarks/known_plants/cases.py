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
        what = "+".join(word for word in self.hidden if word != "sensor") or "nothing"
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


# Under control, from several sensors; the sensor's own faults are those of `sensor`, by its place.
_CONTROLLED_HIDDEN = (
    ("cart and pole", {"coulomb": 1.0}, _dry("cart_mps")),
    ("cart and pole", {"delay": 0.02}, ("dead-time@force_n",)),
    ("cart and pole", {"band": 0.8}, ("dead-band@force_n",)),
    ("cart and pole", {"tilt": 0.5}, ("offset@cart_mps", "bias@force_n")),
    ("cart and pole", {"sensor": 1, "sensor bias": 0.03}, ("sensor-bias@pole_rad",)),
    ("ship", {"most per s": 0.03}, ("rate-limit@rudder_rad",)),
    ("ship", {"wind": 0.01}, ("offset@turn_radps", "bias@rudder_rad")),
    ("ship", {"drag": 30.0}, ("quadratic-drag@turn_radps",)),
    ("ship", {"weathervane": 0.02}, ("gravity@turn_radps", "periodic-force@turn_radps")),
    ("ship", {"sensor": 0, "sensor late": 2.0}, ("sensor-dead-time@heading_rad",)),
    ("ship", {"sensor": 1, "sensor gain": 1.1}, ("sensor-gain@turn_radps",)),
    ("car", {"lag": 0.12}, ("lag@steer_rad",)),
    ("car", {"ratio": 0.88}, ("gain@steer_rad",)),
    ("car", {"wind": 600.0}, ("offset@slip_mps",)),
    ("car", {"sensor": 0, "sensor bias": 0.01}, ("sensor-bias@yaw_radps",)),
    ("car", {"sensor": 0, "sensor gain": 0.9}, ("sensor-gain@yaw_radps",)),
    ("car", {"sensor": 1, "sensor lag": 0.15}, ("sensor-lag@side_mps2",)),
    ("roll", {"lag": 0.03}, ("lag@torque_nm",)),
    ("roll", {"offset": 0.02}, ("offset@rate_radps", "bias@torque_nm")),
    ("roll", {"drag": 0.01}, ("quadratic-drag@rate_radps",)),
    ("roll", {"fades per s": 0.02}, ("drift@torque_nm",)),
    ("roll", {"sensor": 1, "sensor bias": 0.05}, ("sensor-bias@rate_radps",)),
    ("roll", {"sensor": 0, "sensor late": 0.02}, ("sensor-dead-time@roll_rad",)),
    ("oven", {"delay": 40.0}, ("dead-time@duty",)),
    ("oven", {"sensor": 0, "sensor lag": 40.0}, ("sensor-lag@air_k",)),
    ("diver", {"square": 25.0}, ("quadratic-drag@sink_mps",)),
    ("diver", {"buoys": 5.0}, ("offset@sink_mps", "bias@thrust_n")),
    ("diver", {"band": 4.0}, ("dead-band@thrust_n",)),
    ("diver", {"tether": 4.0}, ("preloaded-spring@sink_mps", "stiffness@sink_mps")),
    ("diver", {"uneven": 0.2}, ("asymmetry@thrust_n",)),
    ("diver", {"delay": 0.3}, ("dead-time@thrust_n",)),
    ("arm", {"first rubs": 0.3}, _dry("first_radps")),
    ("arm", {"second rubs": 0.1}, _dry("second_radps")),
    ("arm", {"second gain": 0.85}, ("gain@second_nm",)),
    ("arm", {"spring": 0.5}, ("stiffness@second_radps",)),
    ("arm", {"sensor": 1, "sensor bias": 0.05}, ("sensor-bias@second_rad",)),
    ("arm", {"sensor": 1, "sensor late": 0.03}, ("sensor-dead-time@second_rad",)),
)


def _controlled() -> list[Case]:
    """Each under its own controller, with nothing hidden first; and a law that no effect has."""
    plants = tuple(dict.fromkeys(plant for plant, _, _ in _CONTROLLED_HIDDEN))
    unnamed: tuple[tuple[str, Hidden], ...] = (
        *((plant, {}) for plant in plants),
        ("oven", {"radiation": 0.002}),
    )
    listed = (*((plant, what, ()) for plant, what in unnamed), *_CONTROLLED_HIDDEN)
    return [
        Case(plant, "controlled", what, expected, seed=9000 + k)
        for k, (plant, what, expected) in enumerate(listed)
    ]


CASES = (*_with_hidden(), *_outside(), *_without(), *_controlled())
