"""What public functions check of their arguments before they do anything, so that a wrong one gets one sentence."""

import math
import operator
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import wraps
from inspect import signature
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np

from sidestep.errors import SidestepError

P = ParamSpec("P")
Result = TypeVar("Result")
MOST_WHOLE = 2**63 - 1
MOST_COUNTED = 1_000_000
"""The most maps, walks or futures that anybody may ask for at a time."""


@dataclass(frozen=True)
class Rule:
    """What an argument must be."""

    must: str
    """The rule, as a sentence goes on that begins with the parameter."""

    read: Callable[[Any], Any]
    """Gives the value as the function takes it; raises TypeError, ValueError or OverflowError for any other."""

    def __call__(self, error: type[SidestepError], field: str, value: Any) -> Any:
        """Read an argument.

        Parameters
        ----------
        error
            The kind of error.
        field, value
            Name of the parameter, and what was given.

        Returns
        -------
        Any
            The value as the function takes it, such as a Path where text was given.

        Raises
        ------
        SidestepError
            Any other value; of the kind ``error``, with the parameter as its field.
        """
        try:
            return self.read(value)
        except (TypeError, ValueError, OverflowError) as found:
            raise error(f"{field} {self.must}, not {brief(value)}", field=field) from found


def checked(error: type[SidestepError], **rules: Rule) -> Callable[[Callable[P, Result]], Callable[P, Result]]:
    """Let a public function refuse wrong arguments by itself, before it begins.

    Parameters
    ----------
    error
        The kind of error.
    **rules
        By parameter. None is taken where it is the default.

    Returns
    -------
    Callable
        A decorator of the function.
    """

    def checking(function: Callable[P, Result]) -> Callable[P, Result]:
        parameters = signature(function)
        takes_none = {field for field in rules if parameters.parameters[field].default is None}

        @wraps(function)
        def called(*args: P.args, **kwargs: P.kwargs) -> Result:
            try:
                given = parameters.bind(*args, **kwargs)
            except TypeError as wrong:
                named = re.search(r"'(\w+)'", str(wrong))
                raise error(f"{function.__name__}(): {wrong}", field=named and named[1]) from None
            for field, value in given.arguments.items():
                if field in rules and not (value is None and field in takes_none):
                    given.arguments[field] = rules[field](error, field, value)
            return function(*given.args, **given.kwargs)

        return called

    return checking


def brief(value: object) -> str:
    """A value in a message: in one line, cut where it is long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:60]}…"


def whole(least: int = 0, most: int = MOST_WHOLE) -> Rule:
    """Whole numbers in a range, also those of NumPy and JAX, as an int.

    Parameters
    ----------
    least, most
        The range.

    Returns
    -------
    Rule
        For :func:`checked`.
    """

    def read(value: Any) -> int:
        number = operator.index(value)
        if isinstance(value, bool) or not least <= number <= most:
            raise ValueError
        return number

    limits = f"of at least {least} and below 2**63" if most == MOST_WHOLE else f"from {least} to {most:,}"
    return Rule(f"must be a whole number {limits}", read)


def instance(kind: type | tuple[type, ...], must: str) -> Rule:
    """Objects of a class, or of one of several.

    Parameters
    ----------
    kind, must
        The class, and what it is called after "must be".

    Returns
    -------
    Rule
        For :func:`checked`.
    """

    def read(value: Any) -> Any:
        if not isinstance(value, kind):
            raise TypeError
        return value

    return Rule(f"must be {must}", read)


def one_of(known: Sequence[str]) -> Rule:
    """One of some words.

    Parameters
    ----------
    known
        The words.

    Returns
    -------
    Rule
        For :func:`checked`.
    """

    def read(value: Any) -> str:
        if not isinstance(value, str) or value not in known:
            raise ValueError
        return value

    return Rule(f"must be one of {', '.join(known)}", read)


def each(rule: Rule, must: str, least: int = 1, *, different: bool = False) -> Rule:
    """Lists and other iterables, but no text, whose items keep a rule, as a tuple.

    Parameters
    ----------
    rule, must
        Of the items, and of the whole as it is called after "must be".
    least
        The least number of items.
    different
        Whether no two of them may be alike.

    Returns
    -------
    Rule
        For :func:`checked`.
    """

    def read(value: Any) -> tuple[Any, ...]:
        if isinstance(value, (str, bytes)) or not isinstance(value, Iterable):
            raise TypeError
        items = tuple(map(rule.read, value))
        if len(items) < least or (different and len(set(items)) < len(items)):
            raise ValueError
        return items

    return Rule(f"must be {must}", read)


def _number(value: Any) -> float:
    if isinstance(value, (str, bytes, bool)) or not math.isfinite(number := float(value)):
        raise ValueError
    return number


def _minutes(value: Any) -> float:
    if (number := _number(value)) <= 0:
        raise ValueError
    return number


def _flag(value: Any) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError
    return bool(value)


def _path(value: Any) -> Path:
    if not isinstance(value, (str, os.PathLike)) or not str(value).strip() or "\0" in str(value):
        raise ValueError
    return Path(value)


def _function(value: Any) -> Any:
    if not callable(value):
        raise TypeError
    return value


NUMBER = Rule("must be a finite number", _number)
MINUTES = Rule("must be a positive number of minutes", _minutes)
FLAG = Rule("must be True or False", _flag)
PATH = Rule("must be the name or path of a file or folder", _path)
TEXT = instance(str, "text")
FUNCTION = Rule("must be a function", _function)
SEED = INDEX = whole()
COUNT = whole(1, MOST_COUNTED)
