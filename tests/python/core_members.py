"""Lists the functions of `_core`, and the methods and properties of its classes."""

from collections.abc import Callable
from typing import Any

from pyinfra import _core

# What every class has, and what the package adds in Python.
LEFT_OUT = {
    *("__doc__", "__module__", "__weakref__", "_pybind11_conduit_v1_"),
    *("__repr__", "_repr_html_", "facts"),
}


def classes() -> dict[str, type]:
    """Returns the classes of `_core` by name. Exceptions are left out, because they have no code of
    their own."""
    public = {name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")}
    return {
        name: value
        for name, value in public.items()
        if isinstance(value, type) and not issubclass(value, Exception)
    }


def functions() -> dict[str, Callable[..., Any]]:
    public = {name: getattr(_core, name) for name in dir(_core) if not name.startswith("_")}
    return {name: value for name, value in public.items() if not isinstance(value, type)}


def members() -> set[str]:
    """Returns the names of all functions, methods and properties, such as `suppress`,
    `World.objects` and `World.__init__`."""
    of_classes = {
        f"{name}.{member}"
        for name, kind in classes().items()
        for member in vars(kind).keys() - LEFT_OUT
    }
    return of_classes | functions().keys()


def record_calls() -> set[str]:
    """Replaces all functions, methods and properties by wrappers. Returns the set to which a
    wrapper adds its name when it is called."""
    called: set[str] = set()

    def recorded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*values: object, **named: object) -> object:
            called.add(name)
            return function(*values, **named)

        call.__name__ = name
        return call

    for name, function in functions().items():
        setattr(_core, name, recorded(name, function))
    for class_name, kind in classes().items():
        for name in vars(kind).keys() - LEFT_OUT:
            value: Any = vars(kind)[name]
            full = f"{class_name}.{name}"
            if isinstance(value, property):
                assert value.fget is not None
                setattr(kind, name, property(recorded(full, value.fget)))
            elif isinstance(value, staticmethod):
                setattr(kind, name, staticmethod(recorded(full, value.__func__)))
            else:
                setattr(kind, name, recorded(full, value))
    return called
