"""Loads users' classes and functions by name: `file.py:Name`, `file.py`, or `package.module:Name`."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from soter.errors import ConfigError, account_of, meant, nearest

_FILE: Final = re.compile(r"(?P<file>.+\.py)(:(?P<name>\w+))?", re.DOTALL)

Refused = Callable[[str], ConfigError]
"""Makes an error from a message, with the key and the place of the name in the mission."""


def find_from_here() -> None:
    """Let users' modules be imported from the present folder, as with `python` run there."""
    if "" not in sys.path:
        sys.path.insert(0, "")


def file_of(target: str) -> Path | None:
    """Return the file of a name such as `file.py:Name`; None for a name of another form."""
    found = _FILE.fullmatch(target)
    return None if found is None else Path(found["file"])


def seen_from(folder: Path, target: str) -> str:
    """Return a name, with its file, if it has one, relative to a folder."""
    found = _FILE.fullmatch(target)
    return target if found is None else f"{folder / found['file']}{target[found.end('file') :]}"


def is_target(name: str) -> bool:
    """Return whether a name has a form that `load_named` takes."""
    module, _, last = name.partition(":")
    return file_of(name) is not None or all(part.isidentifier() for part in (*module.split("."), last))


def known_target(name: str, known: Mapping[str, str], kind: str, refused: Refused, *, files: bool = False) -> str:
    """Return the target of a name: that of a built-in name, or the name itself for a user's class.

    Args:
        name: one of `known`, or a name for `load_named`.
        known: the targets of built-in names.
        kind: the kind of the named thing, for the message.
        refused: makes the error.
        files: whether the name may have a file.

    Raises:
        ConfigError: the name is neither.
    """
    if name in known:
        return known[name]
    # Prefixes of built-in names with a colon, such as adversary:, are reserved.
    taken = {each.partition(":")[0] for each in known if ":" in each}
    if is_target(name) and (files or file_of(name) is None) and name.partition(":")[0] not in taken:
        return name
    form = "'file.py:Class' or 'module:Class'" if files else "'module:Class'"
    raise refused(
        f"unknown {kind} '{name}'{nearest(name, [*known])}; known are {', '.join(known)}, or a class as {form}"
    )


def load_class(name: str, target: str, base: type[Any], refused: Refused) -> type[Any]:
    """Import and return the class of a target (see `known_target`), which has to be a subclass of `base`.

    Raises:
        ConfigError: there is no such class, it is no subclass of `base`, it is abstract, or it has made a method async.
    """
    found = load_named(target, refused, base)
    if not (isinstance(found, type) and issubclass(found, base)):
        kind = f"class, but no {base.__name__} of SOTER's" if isinstance(found, type) else type(found).__name__
        raise refused(f"it is '{name}', which is a {kind}; allowed: a subclass of {base.__name__}")
    if inspect.isabstract(found):
        missing = ", ".join(sorted(getattr(found, "__abstractmethods__", ())))
        raise refused(f"it is '{name}', which does not define {missing}")
    if method := _made_async(found):
        raise refused(f"it is '{name}', whose {method} is async; allowed: `def {method}`, since nothing awaits it")
    return found


def _made_async(found: type) -> str:
    """Return the name of an async method in place of one that is not, and so is called and not awaited; else empty."""

    def is_async(method: object) -> bool:
        function = getattr(method, "__func__", method)  # a class method's
        return inspect.iscoroutinefunction(function) or inspect.isasyncgenfunction(function)

    for base in found.__mro__:
        for name, value in vars(base).items():
            if inspect.isroutine(value) and not is_async(value) and is_async(inspect.getattr_static(found, name)):
                return name
    return ""


def load_named(target: str, refused: Refused, base: type | None = None) -> object:
    """Import and return the object that a name stands for.

    A file becomes a module under a name of its own, and its folder is added to the import path, as when Python runs it.

    Args:
        target: `file.py:Name`, `package.module:Name`, or, with a base, `file.py` for the one class of that base in it.
            A file is relative to the present folder.
        refused: makes the error.
        base: base of the class, for `file.py` alone.

    Raises:
        ConfigError: the name has no such form, there is no such file or module, importing it fails, or it has no such
            object.
    """
    found = _FILE.fullmatch(target)
    if found is not None:
        module, name = _from_file(Path(found["file"]), target, refused), found["name"]
        if name is None:
            return _only_class(module, base, target, refused)
    else:
        if not is_target(target):
            raise refused(f"it is '{target}', allowed: a name as 'package.module:name' or 'file.py:name'")
        module_name, _, name = target.partition(":")
        module = _imported(module_name, target, refused)
    value: object = getattr(module, name, None)
    if value is None:
        raise refused(f"it is '{target}', but there is no '{name}' in it{nearest(name, list(vars(module)))}")
    return value


def _from_file(path: Path, target: str, refused: Refused) -> ModuleType:
    path = path.absolute()
    # Two files whose names differ in other characters only, such as a-b.py and a_b.py, are two modules.
    digest = hashlib.sha256(os.fsencode(path)).hexdigest()[:16]
    name = f"soter_file_{re.sub(r'[^a-zA-Z0-9]', '_', str(path))}_{digest}"
    loaded = sys.modules.get(name)
    if loaded is not None:
        return loaded
    spec = importlib.util.spec_from_file_location(name, path)
    if not path.is_file() or spec is None or spec.loader is None:
        raise refused(f"it is '{target}', but there is no file '{path}'{meant(path)}")
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    module = importlib.util.module_from_spec(spec)
    # Dataclasses and annotations look up their module by name.
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code may fail in any way while it is imported
        del sys.modules[name]
        raise refused(f"it is '{target}', but importing it failed: {described(failure, path)}") from failure
    return module


def _imported(name: str, target: str, refused: Refused) -> ModuleType:
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as failure:
        raise refused(
            f"it is '{target}', but there is no module '{failure.name}'; check its spelling, and that it can be "
            "imported from the folder that this runs in"
        ) from failure
    except KeyboardInterrupt:
        raise
    except BaseException as failure:  # foreign code
        raise refused(f"it is '{target}', but importing '{name}' failed: {account_of(failure)}") from failure


def _only_class(module: ModuleType, base: type | None, target: str, refused: Refused) -> type:
    own = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__ and base is not None
        if issubclass(value, base)
    ]
    if len(own) == 1:
        return own[0]
    several, of = len(own) > 1, "" if base is None else f" of soter.{base.__name__}"
    kind = ("classes" if several else "class") if base is None else ("subclasses" if several else "subclass")
    names = f": {', '.join(each.__name__ for each in own)}; say which, as '{target}:{own[0].__name__}'" if own else ""
    raise refused(f"it is '{target}', which has {len(own) or 'no'} {kind}{of}{names}")


def described(failure: BaseException, path: Path | None) -> str:
    """Return an exception in words, with the last line of a file in its traceback, if any."""
    line = account_of(failure, lambda each: f"{type(each).__name__}: {each}".removesuffix(": "))
    return line if isinstance(failure, SyntaxError) else line + line_in(path, failure)


def line_in(path: Path | None, failure: BaseException) -> str:
    """Return the last line of a file in an exception's traceback, as the end of a message; empty without one."""
    file = "" if path is None else str(path.absolute())  # as it was when it was loaded
    inside = [each for each in traceback.extract_tb(failure.__traceback__) if file and each.filename == file]
    return f" ({path.name}, line {inside[-1].lineno})" if inside and path else ""
