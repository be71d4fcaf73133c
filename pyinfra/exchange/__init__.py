"""Import and export of recordings and labels in the formats of other tools."""
