"""What all specs have in common: strict, frozen, and refused with one sentence where they are wrong."""

import re
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo

from sidestep.errors import SidestepError, hint

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class SpecError(SidestepError):
    """Values of a spec that are missing, unknown or wrong.

    ``field`` is the field at fault, as a dotted path, and ``line`` its line in the scenario file, counted from 1.
    """

    others: tuple["SpecError", ...] = ()
    """Further mistakes that were found with this one, in the order of their lines."""


class ScenarioError(SpecError):
    """A scenario that is unknown or wrong."""


class Fault(NamedTuple):
    """One mistake in the values of a spec."""

    path: tuple[str, ...]
    """The field, from the outermost spec inwards."""
    sentence: str
    """What is wrong."""


class _Refusing(ModelMetaclass):
    """Lets constructors raise this package's error."""

    def __call__(cls, *args: Any, **values: Any) -> Any:  # noqa: N805 # of a class
        if args:
            raise cls.refusal(f"{cls.__name__} takes its fields by name, such as field=value")  # type: ignore[attr-defined]
        try:
            return super().__call__(**{name: _plain(value) for name, value in values.items()})
        except ValidationError as error:
            found = faults(error, cls)  # type: ignore[arg-type]
            first, *others = (cls.refusal(said, field=".".join(path) or None) for path, said in found)  # type: ignore[attr-defined]
            first.others = tuple(others)
            raise first from None


def _plain(value: Any) -> Any:
    """Numbers of NumPy as Python's, also in tuples."""
    if isinstance(value, tuple):
        return tuple(map(_plain, value))
    return value.item() if isinstance(value, np.generic) else value


class Spec(BaseModel, metaclass=_Refusing):
    """Plain values without arrays, hashable, not changed by anybody: of a scenario, or the settings of a training.

    Values are taken as they are: no text becomes a number, no list a tuple. Every constructor raises ``refusal``.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, validate_default=True, allow_inf_nan=False)
    refusal: ClassVar[type[SpecError]] = ScenarioError
    """The error where values are wrong."""
    inner: ClassVar[str] = ""
    """The field with a spec whose fields :meth:`changed` takes as well."""

    @property
    def called(self) -> str:
        """What messages call it."""
        return _in_words(type(self))

    def changed(self, /, **changes: object) -> Self:
        """The same with other values, validated again.

        Parameters
        ----------
        **changes
            Fields of this spec, or of the specs in it for which no name is needed: of the place of a scenario and the
            crowd source of a place.

        Returns
        -------
        Self
            A new spec.

        Raises
        ------
        SpecError
            Unknown fields and wrong values; of the kind ``refusal``.
        """
        own = {name: changes.pop(name) for name in type(self).model_fields if name in changes}
        changed = type(self)(**dict(self) | own)
        if not changes:
            return changed
        known = list(_changeable(changed))
        for name in changes:
            if name not in known:
                raise self.refusal(f"{self.called} has no field {name}{hint(name, known)}", field=name)
        return changed.changed(**{self.inner: getattr(changed, self.inner).changed(**changes)})


def _changeable(spec: Spec) -> Iterator[str]:
    yield from type(spec).model_fields
    if spec.inner:
        yield from _changeable(getattr(spec, spec.inner))


# What pydantic's types of errors mean, for a sentence that begins with the field.
_MEANINGS = {
    "missing": "is missing",
    "too_short": "has too few values",
    "too_long": "has too many values",
    "int_type": "must be a whole number",
    "float_type": "must be a number",
    "finite_number": "must be a finite number",
    "string_type": "must be text",
    "string_pattern_mismatch": "must not be blank",
    "bool_type": "must be true or false",
    "tuple_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "model_attributes_type": "must be a table",
    "literal_error": "must be {expected}",
    "union_tag_invalid": "must be {expected_tags}, not '{tag}'",
    "union_tag_not_found": "is missing",
    "greater_than": "must be greater than {gt:g}",
    "greater_than_equal": "must be at least {ge:g}",
    "less_than": "must be less than {lt:g}",
    "less_than_equal": "must be at most {le:g}",
    "value_error": "{error}",
}
_COMPLETE = ("missing", "value_error", "union_tag_invalid", "union_tag_not_found")  # say themselves what there is


def faults(error: ValidationError, kind: type[BaseModel]) -> list[Fault]:
    """The mistakes that pydantic found in the values of a spec.

    Parameters
    ----------
    error
        What it raised.
    kind
        The spec.

    Returns
    -------
    list[Fault]
        In the order of the fields.
    """
    return [_fault(found, kind) for found in error.errors(include_url=False)]


def _fault(found: Any, kind: type[BaseModel]) -> Fault:
    sort, place = found["type"], found["loc"]
    if sort == "extra_forbidden":
        path, kinds = _walk(kind, place[:-1])
        path, known = (*path, str(place[-1])), [field.alias or name for name, field in _fields(kinds)]
        return Fault(path, f"{'.'.join(path)} is unknown{hint(path[-1], known)}")
    path, _ = _walk(kind, (*place, "kind") if sort.startswith("union_tag") else place)
    if sort == "missing" and isinstance(place[-1], int):
        sort = "too_short"
    meaning = _MEANINGS[sort].format_map(found.get("ctx", {})) if sort in _MEANINGS else found["msg"]
    but = "" if sort in _COMPLETE else f", not {shown(found['input'])}"
    return Fault(path, f"{'.'.join(path) or _in_words(kind)} {meaning}{but}")


def _in_words(kind: type[BaseModel]) -> str:
    """What people call a kind of spec, such as the objective."""
    words = re.findall(r"[A-Z][a-z]*", kind.__name__.removesuffix("Spec"))
    return f"the {' '.join(words).lower()}"


def _walk(kind: type[BaseModel], place: Iterable[str | int]) -> tuple[tuple[str, ...], list[type[BaseModel]]]:
    """The fields that lead to a place in a spec, without the tags of unions and numbers of items, and what is there."""
    path: list[str] = []
    kinds = [kind]
    for element in place:
        tagged = [one for one in kinds if "kind" in one.model_fields and one.model_fields["kind"].default == element]
        if len(kinds) > 1 and tagged:
            kinds = tagged
        elif kinds and isinstance(element, str):  # else it is in plain values, or the number of a spec in a list
            path.append(element)
            fields = [(name, field) for name, field in _fields(kinds) if element in (name, field.alias)]
            for name, field in fields[:1]:
                path[-1] = field.alias or name
            kinds = [spec for _, field in fields for spec in _specs_in(field.annotation)] if fields else kinds
    return tuple(path), kinds


def _fields(kinds: list[type[BaseModel]]) -> list[tuple[str, FieldInfo]]:
    return [named for kind in kinds for named in kind.model_fields.items()]


def _specs_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _specs_in(part)


def shown(value: object) -> str:
    """A value in a message, as a scenario file has it: whole, or, where that is long, its beginning."""
    if isinstance(value, dict | BaseModel):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        text = f"[{', '.join(map(shown, value))}]"
    else:
        text = repr(value) if isinstance(value, str | float) else str(value)
    return text if len(text) <= 60 else f"{text[:60]}…"
