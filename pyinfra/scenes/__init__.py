"""Scenes from maps and traffic data of other tools, and random scenes."""
