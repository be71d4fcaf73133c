"""The sections of the report: each takes the material and gives a Section, or None without rows."""
