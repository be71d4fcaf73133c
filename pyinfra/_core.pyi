"""
Compiled part of pyinfra; use pyinfra.sim.
"""
from __future__ import annotations
__all__: list[str] = ['version']
def version() -> str:
    """
    Version of the simulator.
    """
