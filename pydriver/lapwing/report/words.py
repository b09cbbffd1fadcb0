"""What the parts of a summary share: units, tables, plurals."""

UNITS = {"brake_torque": "N·m", "drive_torque": "N·m", "pinion_speed_rpm": "rpm",
         "pinion_speed_rad_s": "rad/s", "mesh_frequency_hz": "Hz", "mesh_stiffness": "N/m",
         "backlash": "rad", "pinion_base_lever": "m", "mesh_damping": "N·s/m",
         "pinion_inertia": "kg·m²", "gear_inertia": "kg·m²"}


NAMES = {"pinion_speed_rpm": "pinion speed", "pinion_speed_rad_s": "pinion speed",
         "mesh_frequency_hz": "mesh frequency"}


def parameter_words(parameter):
    """A parameter in words, without its unit."""
    return NAMES.get(parameter, parameter.replace("_", " "))


def markdown(rows):
    """Lines of a table; the first row is its heading."""
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return [lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]


def plural(number, word):
    """Number and word, the word with an s unless the number is one."""
    return f"{number:g} {word}" + "s" * bool(number != 1)


def method_words(attrs):
    """How the motion was followed: 'in closed form', or rk4 and its tolerance."""
    if attrs["method"] == "exact":
        return "in closed form"
    return f"rk4 at tolerance {attrs['rtol']:g}"
