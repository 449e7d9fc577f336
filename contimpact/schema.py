"""Tables and records, declared once: a dataclass is the table, its fields are the keys.

A field made by `key` says what it means, what is admitted, and what holds where nothing is given.
Reading, writing and the documentation's tables follow from it, for what is asked (scenes, studies)
and for what is found (`record`). A mistake is refused with the path
of its key, what was found and what would do. Everything has a bound, so that no file can ask for
more than a machine has.
"""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache
from numbers import Integral
from types import SimpleNamespace
from typing import Any, TypeVar

from .errors import InputError, did_you_mean, each_once, short_repr

T = TypeVar("T")

LARGEST_NUMBER = 1e100
LONGEST_TEXT = 10_000
LONGEST_LIST = 10_000
REQUIRED: Any = dataclasses.MISSING
_LINK = re.compile(r"\[([^\]]+)\]\([^)]+\)")


@dataclasses.dataclass(frozen=True)
class Key:
    """A key of a table, as `key` declares it.

    Functions take what was read before as their last argument: the fields of the same dataclass,
    and in `scene` those of the one around it.
    """

    doc: str = ""
    """What it means, for the documentation's table."""
    table: str = ""
    """The table below the dataclass's own in which it is, if not in that itself."""
    name: str = ""
    """Its name where it is not the field's."""
    least: Any = None
    most: Any = None
    """`least`, `most`: bounds of numbers, or functions that return them; 1 by default for whole
    numbers."""
    above: float | None = None
    """What a number has to exceed."""
    choices: Sequence[str] = ()
    usual: Callable[[Any], Any] | None = None
    """Returns the default, where it depends on what was read before."""
    each: Callable[[Any, str, Any], Any] | None = None
    """Checks an item of a list at a place, and returns it."""
    check: Callable[[Any, str, Any], Any] | None = None
    """Checks the value, given or by default, at its place, and returns it."""
    given: Any = None
    """The type in the file where it is not the field's, which `check` then returns."""
    write: Callable[[Any], Any] | None = None
    inline: Mapping[str, Mapping[str, Any]] | None = None
    """Keys of the dataclass that is the field's type which are in the same table, and what is
    otherwise in their rules here."""
    silent: bool = False
    """Whether it is written only where it differs from the default."""
    column: bool = False
    """Whether it is a column where records are rows of a table."""
    accepted: str = ""
    """What would do, in words; by default the type and the bounds say it."""
    shown: str = ""
    """The default in words."""


PLAIN = Key()


def key(default: Any = REQUIRED, doc: str = "", **rules: Any) -> Any:
    """Return a field of a dataclass that is a key of its table; see `Key`."""
    rule = {"key": Key(doc, **rules)}
    if isinstance(default, dict):
        return dataclasses.field(default_factory=default.copy, metadata=rule)
    return dataclasses.field(default=default, metadata=rule)


def attribute(doc: str = "", default: Any = REQUIRED, **rules: Any) -> Any:
    """Return a field of a dataclass that is a key of its record; see `Key`."""
    return key(default, doc, **rules)


@cache
def keys_of(kind: Any) -> list[tuple[dataclasses.Field[Any], Any, Key]]:
    """Return the keys that a dataclass declares: fields, their types and their rules."""
    hints = typing.get_type_hints(kind)
    fields = dataclasses.fields(kind)
    rules = [(field, field.metadata["key"]) for field in fields if "key" in field.metadata]
    return [(field, rule.given or hints[field.name], rule) for field, rule in rules]


def documented(kind: type[T]) -> type[T]:
    """Return a dataclass whose docstring lists its keys; links of the pages are texts there."""
    lines = []
    for field, _, rule in keys_of(typing.cast(Any, kind)):
        doc = _LINK.sub(r"\1", rule.doc)
        lines.append(f"{field.name} : {field.type}\n    {doc[:1].upper()}{doc[1:]}.")
    text, raises, errors = (inspect.getdoc(kind) or "").partition("\n\nRaises")
    listed = "\n".join(["\n\nAttributes\n----------", *lines])
    kind.__doc__ = f"{text}{listed}{raises}{errors}\n"
    return kind


class Table:
    """A table at a path; gives what is at its keys, and refuses those that nothing asks for."""

    def __init__(self, data: Mapping[str, Any], path: str = "") -> None:
        self.data, self.path = data, path
        self.asked: list[str] = []

    def place(self, name: str) -> str:
        """Return the path of a key."""
        return f"{self.path}.{name}" if self.path else name

    def has(self, name: str) -> bool:
        """Whether a key is there; it counts as read."""
        self.asked.append(name)
        return name in self.data

    def get(self, name: str, hint: Any, default: Any = REQUIRED, **rules: Any) -> Any:
        """Return what is at a key as a type has it, or the default; see `Key` for the rules."""
        rule = Key(**rules)
        if self.has(name):
            return fit(self.data[name], hint, self.place(name), rule)
        if default is REQUIRED:
            raise self.missing(name, wanted(hint, self.place(name), rule, None))
        return default

    def table(self, name: str, optional: bool = False) -> Table:
        """Return the table at a key; an empty one if it is optional and missing."""
        empty = {} if optional else REQUIRED
        return Table(self.get(name, Mapping[str, Any], empty), self.place(name))

    def finish(self) -> None:
        """Refuse the keys that nothing has asked for."""
        asked = list(dict.fromkeys(self.asked))
        for name in self.data:
            if name not in asked:
                found = f"unknown key{did_you_mean(name, asked)}"
                raise InputError(self.place(name), found, f"accepted are {', '.join(asked)}")

    def missing(self, name: str, accepted: str) -> InputError:
        """Return the error for a key that is missing; one that is spelled alike is taken for it."""
        import difflib

        others = [other[:100] for other in self.data if other not in self.asked]
        for near in difflib.get_close_matches(name, others[:100], 1):
            found = f"unknown key (did you mean {name!r}?)"
            missing = f"{self.place(name)} is missing: give {accepted}"
            return InputError(self.place(near), found, missing)
        return InputError(self.place(name), "missing", f"give {accepted}")


def read(
    kind: type[T],
    data: Any,
    path: str = "",
    scene: Any = None,
    *,
    partly: bool = False,
    **known: Any,
) -> T:
    """Return a dataclass as a table at a path gives it; `scene` is what was read around it, and
    `known` are fields that are no keys. Where it is read `partly`, others read its other keys."""
    here, table = SimpleNamespace(scene=scene, **known), Table(data, path)
    inner = _read_keys(kind, table, here)
    for each in (*inner, *[table] * (not partly)):
        each.finish()
    return _made(kind, here, path)


def _read_keys(
    kind: type[Any], top: Table, here: SimpleNamespace, changes: Any = None
) -> Iterable[Table]:
    """Read the keys of a dataclass into `here`, which may have defaults; returns the tables below
    its own. Where there are `changes`, they name the keys, and what is otherwise in their rules."""
    tables: dict[str, Table] = {}
    for field, hint, rule in keys_of(typing.cast(Any, kind)):
        if changes is not None:
            if field.name not in changes:
                continue
            rule = dataclasses.replace(rule, **changes[field.name])
        default = _default(field, rule, here)
        if rule.table and rule.table not in tables:
            tables[rule.table] = top.table(rule.table, default is not REQUIRED)
        table, name = tables.get(rule.table, top), rule.name or field.name
        place = table.place(name)
        if rule.inline is not None:
            known = {} if default is REQUIRED else vars(default(here))
            inside = SimpleNamespace(scene=here.scene, **known)
            _read_keys(hint, table, inside, rule.inline)
            value = _made(hint, inside, table.path)
        elif table.has(name):
            value = fit(table.data[name], hint, place, rule, here)
        elif default is REQUIRED:
            raise table.missing(name, wanted(hint, place, rule, here))
        else:
            value = default(here)
        if rule.check and value is not None:
            value = rule.check(value, place, here)
        setattr(here, field.name, value)
    return tables.values()


def _made(kind: type[T], here: SimpleNamespace, path: str) -> T:
    del here.scene
    try:
        return kind(**vars(here))
    except InputError as error:
        raise error.within(path) if path else error from None


def _default(field: dataclasses.Field[Any], rule: Key, known: SimpleNamespace) -> Any:
    """A function that returns a key's default, or `REQUIRED`."""
    if hasattr(known, field.name):
        return lambda here: getattr(known, field.name)
    if rule.usual:
        return rule.usual
    made: Any = field.default_factory
    if made is not REQUIRED:
        return lambda here: made()
    return REQUIRED if field.default is REQUIRED else lambda here: field.default


def fit(value: Any, hint: Any, where: str, rule: Key = PLAIN, here: Any = None) -> Any:
    """Return a value as a type has it: a text, a number, a boolean, a tuple, list or mapping of
    these, a dataclass with keys, or a union, of which None is never given."""
    kind, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return value

    def refusal() -> InputError:
        accepted = f"give {wanted(hint, where, rule, here)}"
        return InputError(where, f"found {short_repr(value)}", accepted)

    if kind in (types.UnionType, typing.Union):
        return _fit_union(value, inner, where, rule, here)
    if hint is float:
        return _number(value, where, rule, refusal)
    if hint is str and isinstance(value, str):
        if len(value) > LONGEST_TEXT:
            raise InputError(where, f"{len(value)} characters", f"at most {LONGEST_TEXT} do")
        if rule.choices and value not in rule.choices:
            if rule.accepted:
                raise refusal()
            raise InputError(where, f"found {value!r}", f"accepted are {', '.join(rule.choices)}")
        return value
    if hint is bool and isinstance(value, bool):
        return value
    if hint is int and isinstance(value, Integral) and not isinstance(value, bool):
        whole, (least, most) = int(value), _bounds(rule, here)
        if least <= whole and (most is None or whole <= most):
            return whole
    if kind in (tuple, list) and isinstance(value, list | tuple):
        if len(value) > LONGEST_LIST:
            found, accepted = f"a list of {len(value)}", f"at most {LONGEST_LIST} are admitted"
            raise InputError(where, found, accepted)
        if inner[0] in (str, int) and any(type(item) is not inner[0] for item in value):
            raise refusal()
        items = [fit(item, inner[0], f"{where}[{i}]", rule, here) for i, item in enumerate(value)]
        if kind is tuple and inner[1:] != (Ellipsis,):
            if len(items) == len(inner) and items[0] < items[1]:
                return tuple(items)
            raise refusal()
        items = each_once(items, where)
        if rule.each:
            items = [rule.each(item, f"{where}[{i}]", here) for i, item in enumerate(items)]
        return kind(items)
    if kind is Mapping and isinstance(value, Mapping):
        if inner[1] is Any:
            return value
        return {name: fit(v, inner[1], f"{where}.{name}", rule, here) for name, v in value.items()}
    if dataclasses.is_dataclass(hint) and isinstance(value, Mapping):
        return read(typing.cast(Any, hint), value, where, here)
    raise refusal()


def _fit_union(value: Any, hints: Sequence[Any], where: str, rule: Key, here: Any) -> Any:
    others = [hint for hint in hints if hint is not types.NoneType]
    if len(others) == 1:
        return fit(value, others[0], where, rule, here)
    for hint in others:
        listed = typing.get_origin(hint) in (tuple, list)
        if (listed and isinstance(value, list)) or type(value) is hint:
            return fit(value, hint, where, rule, here)
    accepted = wanted(types.UnionType, where, rule, here)
    raise InputError(where, f"found {short_repr(value)}", f"give {accepted}")


def _number(value: Any, where: str, rule: Key, refusal: Callable[[], InputError]) -> float:
    if isinstance(value, str):
        from .models.expressions import number

        value = number(value, where)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise refusal()
    if not -LARGEST_NUMBER <= value <= LARGEST_NUMBER:
        accepted = f"give a finite number, at most {LARGEST_NUMBER:g} in size"
        raise InputError(where, refusal().found, accepted)
    low = rule.above is not None and not value > rule.above
    if low or (rule.most is not None and value > rule.most):
        most = "" if rule.most is None else f", at most {rule.most:g}"
        raise InputError(
            where, f"found {float(value)!r}", f"give a number above {rule.above:g}{most}"
        )
    return float(value)


def _bounds(rule: Key, here: Any) -> tuple[int, int | None]:
    """The least and the largest whole number of a key."""
    least, most = (b(here) if callable(b) else b for b in (rule.least, rule.most))
    return 1 if least is None else least, most


_WORDS = {
    str: "a text in quotes",
    bool: "true or false",
    float: "a number, or an expression in quotes",
}
_LISTS = {str: "texts in quotes", float: "numbers"}


def wanted(hint: Any, where: str, rule: Key, here: Any) -> str:
    """Return what would do for a type, in words."""
    kind, inner = typing.get_origin(hint), typing.get_args(hint)
    if rule.accepted:
        return rule.accepted
    if kind in (types.UnionType, typing.Union):
        return wanted(inner[0], where, rule, here)
    if hint is str and rule.choices:
        return " or ".join(f'"{choice}"' for choice in rule.choices)
    if hint is int:
        least, most = _bounds(rule, here)
        return f"a whole number from {least}" + (f" to {most}" if most else "")
    if kind is tuple and inner[1:] != (Ellipsis,):
        return "two numbers, the lower one first"
    if kind in (tuple, list):
        return f"a list of {_LISTS.get(inner[0], 'texts in quotes')}"
    return _WORDS.get(hint, f"a table [{where}]")


def written(one: Any) -> dict[str, Any]:
    """Return a dataclass as its table would be given, every default filled in, as plain data."""
    found: dict[str, Any] = {}
    for field, _, rule in keys_of(typing.cast(Any, type(one))):
        value = getattr(one, field.name)
        if (value is None and not rule.write) or (rule.silent and value == field.default):
            continue
        into = found.setdefault(rule.table, {}) if rule.table else found
        if rule.inline:
            into |= {name: v for name, v in written(value).items() if name in rule.inline}
        else:
            into[rule.name or field.name] = rule.write(value) if rule.write else plain(value)
    return found


def plain(value: Any, of: Callable[[Any], Any] = written) -> Any:
    """Return a value as plain data: lists, mappings, texts and numbers."""
    if dataclasses.is_dataclass(value):
        return of(value)
    if isinstance(value, Mapping):
        return {name: plain(v, of) for name, v in value.items()}
    return [plain(v, of) for v in value] if isinstance(value, list | tuple) else value


def record(one: Any, names: Iterable[str] = ()) -> dict[str, Any]:
    """Return a dataclass as a record, plain data: what applies not is None, or left out where it is
    silent. `names` are the fields and properties in it, by default all fields."""
    rules = {field.name: field.metadata.get("key", PLAIN) for field in dataclasses.fields(one)}
    found = {}
    for name in names or rules:
        value, rule = getattr(one, name), rules.get(name, PLAIN)
        if value is not None or not rule.silent:
            found[rule.name or name] = rule.write(value) if rule.write else plain(value, record)
    return found


def table_columns(kind: Any) -> list[str]:
    """Return the keys that are columns where records are rows of a table."""
    return [rule.name or field.name for field, _, rule in keys_of(kind) if rule.column]


# Plain data, as JSON has it, made into dataclasses whose annotations it has to fit.

NOT_FINITE = ("inf", "-inf", "nan")
LARGEST_WHOLE = 2**63 - 1


def build_record(kind: type[T], record: Any, needed: Collection[str] | None = None) -> T:
    """Return a dataclass made of a record; keys that it does not have are passed over.

    Its annotations may be texts, numbers, booleans, enumerations (by name), sequences, tuples,
    mappings, other dataclasses, None besides any of these, and Any. Keys that are `needed` are
    required, by default all without a default value; others are None if they are missing.

    Raises ValueError if a key is missing or its value does not fit.
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"found {short_repr(record)} in place of a record")
    values = {}
    hints = _hints(typing.cast(Any, kind))
    for field, hint in hints:
        value = record.get(field.name)
        if value is not None:
            values[field.name] = fit_value(value, hint, field.name)
        elif _needs_value(field, hint, field.name in record, needed):
            raise ValueError(f"a record without {field.name}")
        elif field.name in record or not _has_default(field):
            values[field.name] = None
    return kind(**values)


@cache
def _hints(kind: type[Any]) -> list[tuple[dataclasses.Field[Any], Any]]:
    hints = typing.get_type_hints(kind)
    return [(field, hints[field.name]) for field in dataclasses.fields(kind)]


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _needs_value(
    field: dataclasses.Field[Any], hint: Any, given: bool, needed: Collection[str] | None
) -> bool:
    """Whether None, or nothing, cannot stand for a field."""
    if needed is not None:
        return field.name in needed
    optional = hint is Any or types.NoneType in typing.get_args(hint)
    return not (optional if given else _has_default(field))


def fit_value(value: Any, hint: Any, name: str) -> Any:
    """Return a value as an annotation has it, or raise `ValueError` naming where it stands."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    made = dataclasses.is_dataclass(value) or hasattr(value, "dtype")  # and checked, by others
    if hint is Any or made:
        return value
    if origin in (types.UnionType, typing.Union):
        return _fit_value_of_union(value, inner, name)
    if hint in _PLAIN and (plain := _PLAIN[hint](value)) is not None:
        return plain
    if origin is tuple and isinstance(value, list | tuple) and inner[1:] == (Ellipsis,):
        return tuple(fit_value(v, inner[0], name) for v in value)
    if origin is tuple and isinstance(value, list | tuple) and len(value) == len(inner):
        return tuple(fit_value(v, h, name) for v, h in zip(value, inner, strict=True))
    if origin is Sequence and isinstance(value, list | tuple):
        return [fit_value(v, inner[0], name) for v in value]
    if origin is Mapping and isinstance(value, Mapping):
        return {str(key): fit_value(v, inner[1], f"{name}.{key}") for key, v in value.items()}
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return build_record(hint, value)
    if isinstance(hint, enum.EnumMeta) and value in hint.__members__:
        return hint[value]
    raise ValueError(f"{name} is {short_repr(value)}")


def _fit_value_of_union(value: Any, hints: Sequence[Any], name: str) -> Any:
    if value is None and types.NoneType in hints:
        return None
    for hint in hints:
        try:
            return fit_value(value, hint, name)
        except ValueError:
            continue
    raise ValueError(f"{name} is {short_repr(value)}")


def _double(value: Any) -> float | None:
    """A number; what is not finite may be written as a text."""
    if isinstance(value, str):
        return float(value) if value in NOT_FINITE else None
    whole = type(value) is int and abs(value) <= sys.float_info.max
    return float(value) if whole or isinstance(value, float) else None


def _whole_number(value: Any) -> int | None:
    plain = isinstance(value, int) and not isinstance(value, bool)
    return value if plain and abs(value) <= LARGEST_WHOLE else None


_PLAIN: dict[Any, Any] = {
    str: lambda value: value if isinstance(value, str) else None,
    bool: lambda value: value if isinstance(value, bool) else None,
    int: _whole_number,
    float: _double,
    complex: lambda value: value if isinstance(value, complex) else None,
}
