"""What ROS fixes about the fields of its messages: units, and which hold no measurement.

In: the type of a message and a field's name. Out: a unit, a remark where ROS leaves it open.
Units are those of the comments in common_interfaces and ackermann_msgs (REP 103: SI units).
"""

_TURN_OR_SLIDE = "? {} of a joint that turns, {} of one that slides"
_UNITS = {
    "geometry_msgs/msg/Accel": {"linear": "m/s^2", "angular": "rad/s^2"},
    "geometry_msgs/msg/PointStamped": {"point": "m"},
    "geometry_msgs/msg/Pose": {"position": "m"},
    "geometry_msgs/msg/Pose2D": {"x": "m", "y": "m", "theta": "rad"},
    "geometry_msgs/msg/Quaternion": dict.fromkeys("xyzw", "1"),
    "geometry_msgs/msg/Transform": {"translation": "m"},
    "geometry_msgs/msg/Twist": {"linear": "m/s", "angular": "rad/s"},
    "geometry_msgs/msg/Wrench": {"force": "N", "torque": "N m"},
    "ackermann_msgs/msg/AckermannDrive": {
        "steering_angle": "rad", "steering_angle_velocity": "rad/s", "speed": "m/s",
        "acceleration": "m/s^2", "jerk": "m/s^3",
    },
    "sensor_msgs/msg/BatteryState": {"voltage": "V", "current": "A"},
    "sensor_msgs/msg/FluidPressure": {"fluid_pressure": "Pa"},
    "sensor_msgs/msg/Imu": {"angular_velocity": "rad/s", "linear_acceleration": "m/s^2"},
    "sensor_msgs/msg/LaserScan": {
        "angle_min": "rad", "angle_max": "rad", "angle_increment": "rad", "time_increment": "s",
        "scan_time": "s", "range_min": "m", "range_max": "m", "ranges": "m",
    },
    "sensor_msgs/msg/MagneticField": {"magnetic_field": "T"},
    "sensor_msgs/msg/NavSatFix": {"latitude": "deg", "longitude": "deg", "altitude": "m"},
    "sensor_msgs/msg/Range": {
        "range": "m", "min_range": "m", "max_range": "m", "field_of_view": "rad",
    },
}  # fmt: skip
_OPEN = {
    "sensor_msgs/msg/JointState": {
        "position": _TURN_OR_SLIDE.format("rad", "m"),
        "velocity": _TURN_OR_SLIDE.format("rad/s", "m/s"),
        "effort": _TURN_OR_SLIDE.format("N m", "N"),
    },
    "sensor_msgs/msg/Temperature": {"temperature": '? °C: give "K", and offset = 273.15'},
}
_STAMP = "std_msgs/msg/Header"


def unit_of(kind: str, name: str) -> str | None:
    """The unit of a field, and of all below it; None where ROS fixes none."""
    return _UNITS.get(kind, {}).get(name)


def remark_on(kind: str, name: str) -> str:
    """What ROS says of a field whose unit it leaves open."""
    return _OPEN.get(kind, {}).get(name, "")


def is_aside(kind: str, name: str) -> bool:
    """Whether a field of a message of ROS is no measurement: a covariance, or a header."""
    return bool(kind) and (kind == _STAMP or name.endswith("covariance"))
