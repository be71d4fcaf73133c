"""Compass bearings of mounts. In a site, x points east and y north."""

NAMES = (
    "north",
    "north-east",
    "east",
    "south-east",
    "south",
    "south-west",
    "west",
    "north-west",
)


def looks_to(yaw_deg: float) -> str:
    """Returns the compass bearing of a yaw as text, such as `90 degrees (east)` for yaw 0."""
    bearing = (90 - yaw_deg) % 360
    return f"{round(bearing) % 360} degrees ({NAMES[round(bearing / 45) % len(NAMES)]})"
