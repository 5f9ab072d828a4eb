"""ambid: parameters of active magnetic bearings from the machine's own closed loop.

Every public name is listed in ``__init__.pyi``; the room that it comes from is opened when it is first used.
"""

from types import ModuleType

import lazy_loader

from ambid.results import pictures_by

_open, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _pictures() -> ModuleType:
    """Results are drawn by a room above them."""
    from ambid import plot  # not at the top: it opens all rooms

    return plot


pictures_by(_pictures)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from importlib.metadata import version  # not at the top: it is most of what `import ambid` would take

        return version("ambid")
    return _open(name)
