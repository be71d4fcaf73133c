"""Copies, pickles and shows worlds and LiDARs of the compiled core.

A pickle has the call that creates the object, and the files that this process wrote for the call.
"""

import copyreg
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import yaml

from pyinfra._core import Lidar, World
from pyinfra.core.errors import Error
from pyinfra.core.present import Presented
from pyinfra.dataset.own_files import named_in, put

Made = TypeVar("Made", World, Lidar)
_RECIPES: WeakKeyDictionary[Any, Callable[[], Any]] = WeakKeyDictionary()


def remembered(made: Made, recipe: Callable[[], Made]) -> Made:
    """Stores the function that recreates an object in any process, and returns the object."""
    _RECIPES[made] = recipe
    return made


def recipe_of(made: World | Lidar) -> Any:
    """Returns the stored call that created an object. Raises Error if there is none."""
    if made not in _RECIPES:
        name = type(made).__name__
        raise Error(
            f"{name}: expected a result of load_scene or load_lidar, got an object that another "
            "function made"
        )
    return _RECIPES[made]


def _reduced(made: World | Lidar) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    recipe = recipe_of(made)
    return _again, (recipe, named_in(repr(recipe)))


def _again(recipe: Callable[[], Any], files: dict[Path, bytes]) -> Any:
    put(files)
    return remembered(recipe(), recipe)


def _changed(recipe: Callable[[], Lidar], name: str, args: tuple[object, ...]) -> Lidar:
    lidar: Lidar = getattr(recipe(), name)(*args)
    return lidar


def _with_recipe(name: str) -> Callable[..., Lidar]:
    """Wraps a method of Lidar, so that its result can be recreated too if the LiDAR can be."""
    method = getattr(Lidar, name)

    @wraps(method)
    def call(self: Lidar, *args: Any, **named: Any) -> Lidar:
        made: Lidar = method(self, *args, **named)
        if self not in _RECIPES:
            return made
        return remembered(made, partial(_changed, _RECIPES[self], name, (*args, *named.values())))

    return call


def _facts(made: World | Lidar) -> dict[str, object]:
    if isinstance(made, Lidar):
        return {"name": made.name, "preset": made.preset, "period_s": made.period_s}
    first, _, _ = made.dump().partition("\n")  # parsing more than the first line would take long
    return {"name": yaml.safe_load(first)["name"], "frames": made.frames}


for _name in ("with_echo", "with_every_hit", "with_free_motors", "with_law_exponent", "with_rate"):
    setattr(Lidar, _name, _with_recipe(_name))


_kind: Any
for _kind in (World, Lidar):
    copyreg.pickle(_kind, _reduced)
    _kind.facts = _facts
    _kind.__repr__ = Presented.__repr__
    _kind._repr_html_ = Presented._repr_html_
