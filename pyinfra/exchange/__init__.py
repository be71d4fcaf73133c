"""Recordings and labels of other tools, in and out."""
