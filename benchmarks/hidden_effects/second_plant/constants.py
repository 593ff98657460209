"""All numbers of the second plant, SI units and µs, as plain floats."""

from typing import NamedTuple


class Wake(NamedTuple):
    """The wake as a rig file states it; the jet of this plant is calibrated to these numbers."""

    speed_mps: float = 6.0
    diffusivity_m2ps: float = 0.06
    decay_per_s: float = 0.3
    strength: float = 380.0
    width_m: float = 0.09
    drag_area_m2: float = 0.05
    reference_thrust_n: float = 4.41
    speed_exponent: float = 0.0


class Curve(NamedTuple):
    """Static thrust [N] over the pulse width [µs], linear between points, then bent.

    The thrust is scale · hover · (tabulated / hover)^exponent.
    """

    pulse_us: tuple[float, ...]
    thrust_n: tuple[float, ...]
    scale: float = 1.0
    exponent: float = 1.0


class Numbers(NamedTuple):
    """What the equations of motion use; the defaults are the neutral values of every effect."""

    mass_kg: float = 0.45
    gravity_mps2: float = 9.81
    rotor_radius_m: float = 0.127
    travel_m: float = 1.2
    source_height_m: float = 2.0
    # Spool: a first-order rotor behind the first-order current of its windings, which takes
    # `electrical_share` of the lag's mean.
    source_up_s: float = 0.06
    source_down_s: float = 0.10
    sufferer_up_s: float = 0.06
    sufferer_down_s: float = 0.10
    electrical_share: float = 0.02
    # Rail: Stribeck's curve from `stiction_n` at rest down to `coulomb_n`.
    coulomb_n: float = 0.05
    stiction_n: float = 0.08
    viscous_n_per_mps: float = 0.05
    stribeck_mps: float = 0.005
    # Thrust losses.
    resistance: float = 0.0  # share of the voltage lost when both motors pull the weight
    sag_per_s: float = 0.0  # share of the thrust lost per second of hover so far
    inflow_s_per_m: float = 0.0  # share of the thrust lost per m/s of climb
    wake_inflow_s_per_m: float = 0.0  # share of the thrust lost per m/s of downward air
    # Forces.
    recirculation: float = 0.0  # share of the thrust lost on the floor, at hover
    recirculation_height_m: float = 0.15
    tether_n_per_m: float = 0.0
    tether_slack_m: float = 0.0
    added_mass_kg: float = 0.0
    # Wake geometry.
    offset_m: float = 0.0
    deflection_s: float = 0.0
    lost_steps: float = 0.0
    backlash_m: float = 0.0
    # Beyond any library: see `motion.further_forces`.
    vibration_n: float = 0.0
    vibration_hz: float = 2.0
    vibration_phase: float = 0.0
    detent_n: float = 0.0
    detent_m: float = 0.09
    bend_n_per_m: float = 0.0
    climb_drag_n_s2_per_m2: float = 0.0
    gust_n: float = 0.0
    gust_start_s: float = 8.0
    gust_end_s: float = 11.0
    coupling: float = 0.0  # share of the voltage lost per √N that the source has yet to gain
    mast_n: float = 0.0
    mast_hz: float = 2.2
    mast_damping: float = 0.08


class Sensing(NamedTuple):
    """Range sensor, servo frame and the air's unrest."""

    noise_m: float = 0.004
    period_s: float = 0.02
    resolution_m: float = 0.001
    delay_s: float = 0.009
    bias_m: float = 0.0
    scale: float = 1.0
    drift_mps: float = 0.0
    hold_s: float = 0.0
    stale_s: float = 0.0  # how much older readings are than their time stamps say
    outlier_probability: float = 0.005
    outlier_size_m: float = 0.15
    steps_per_m: float = 4200.0
    frame_s: float = 0.02
    command_delay_s: float = 0.0
    dead_band_us: float = 0.0
    quantum_us: float = 0.0
    turbulence_fraction: float = 0.04
    turbulence_time_s: float = 0.08


_PULSE = (1000.0, 1050.0, 1100.0, 1200.0, 1300.0, 1400.0, 1500.0, 1600.0, 1700.0, 1800.0)
_SQUARE = tuple(4.41 * ((p - 1000.0) / 700.0) ** 2 for p in (*_PULSE, 1900.0, 2000.0))
SQUARE_CURVE = Curve((*_PULSE, 1900.0, 2000.0), _SQUARE)


class Constants(NamedTuple):
    """One rig of the second plant.

    `ground_height_m` and `ground_factor` are a table of the thrust's increase near the floor.
    """

    numbers: Numbers = Numbers()
    sensing: Sensing = Sensing()
    wake: Wake = Wake()
    source: Curve = SQUARE_CURVE
    sufferer: Curve = SQUARE_CURVE
    idle_us: float = 1000.0
    ground_height_m: tuple[float, ...] = (0.0, 10.0)
    ground_factor: tuple[float, ...] = (1.0, 1.0)
