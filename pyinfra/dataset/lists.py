"""The names that the loading functions accept."""

from __future__ import annotations

from pyinfra.core.public import public
from pyinfra.core.vocabulary import PRESETS
from pyinfra.dataset.catalogue import shipped


@public()
def list_scenes() -> list[str]:
    """Returns the names of the shipped scenes, which `load_scene` accepts.

    Parameters
    ----------
    None

    Returns
    -------
    Names, sorted

    Raises
    ------
    Error : for an argument

    Examples
    --------
    >>> import pyinfra as pi
    >>> "highway" in pi.list_scenes()
    True
    """
    return sorted(shipped("scenes"))


@public()
def list_lidars() -> list[str]:
    """Returns the names of the shipped LiDARs, which `load_lidar` accepts.

    Parameters
    ----------
    None

    Returns
    -------
    Names, sorted

    Raises
    ------
    Error : for an argument

    Examples
    --------
    >>> import pyinfra as pi
    >>> "ruby_plus" in pi.list_lidars()
    True
    """
    return sorted(shipped("lidars"))


@public()
def list_presets() -> list[str]:
    """Returns the presets of the shipped LiDARs.

    Parameters
    ----------
    None

    Returns
    -------
    Names, sorted

    Raises
    ------
    Error : for an argument

    Examples
    --------
    >>> import pyinfra as pi
    >>> pi.list_presets()
    ['datasheet', 'equal', 'paper']
    """
    return sorted(PRESETS)
