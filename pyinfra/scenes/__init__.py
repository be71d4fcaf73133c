"""Scenes from maps and traffic of other tools, and random scenes."""
