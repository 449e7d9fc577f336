"""Programs in the plain subset of Python as LLVM's intermediate code.

Every function is translated once for each list of its arguments' types: numbers, tuples of values,
views of arrays, and functions, which are known while translating. Types of variables are those of
all that is assigned to them, where a whole number joined with a float is a float. Arithmetic is
that of Python on doubles, operation by operation, but for a division by zero, which is infinite or
no number.

A program is as many modules as its functions come from files, and one of those that are written for
a model: the others are the same for many models, and compiled once. Short functions are copied to
where they are called, but for those written for a model.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import math
import struct
from collections.abc import Callable, Mapping, Sequence, Set
from typing import TYPE_CHECKING, Any, NamedTuple

from ..arrays import ENTRY, INTEGERS, TABLE, VECTOR

if TYPE_CHECKING:
    from .machine_code import Program

# Types: "double", "i64" and "i1" of LLVM for numbers, and the following.


class TupleType(NamedTuple):
    """A tuple; `fields` are the names of a named one's."""

    items: tuple[Any, ...]
    fields: tuple[str, ...] = ()


class ViewType(NamedTuple):
    """A view of a contiguous array."""

    number: str
    dimensions: int


class FunctionType(NamedTuple):
    """One function of the program, or one of `math`."""

    name: str


NOTHING = TupleType(())
"""What a function without a value returns."""

POINTERS = {INTEGERS: ("i64", 1), VECTOR: ("double", 1), TABLE: ("double", 2)}


class Value(NamedTuple):
    """A value: its type, and the LLVM values of its leaves."""

    type: Any
    leaves: tuple[str, ...]


def leaf_types(of: Any) -> tuple[str, ...]:
    """The LLVM types that a value is passed as."""
    if isinstance(of, TupleType):
        return tuple(leaf for item in of.items for leaf in leaf_types(item))
    if isinstance(of, ViewType):
        return ("ptr", *["i64"] * of.dimensions)
    return () if isinstance(of, FunctionType) else (of,)


def _join(one: Any, other: Any) -> Any:
    """The type of a variable that is of both types at times."""
    if one == other:
        return one
    if {one, other} <= {"double", "i64", "i1"}:
        return "double" if "double" in (one, other) else "i64"
    same = isinstance(one, TupleType) and isinstance(other, TupleType)
    if same and len(one.items) == len(other.items) and one.fields == other.fields:
        pairs = zip(one.items, other.items, strict=True)
        return TupleType(tuple(_join(a, b) for a, b in pairs), one.fields)
    raise NotImplementedError(f"a variable is {one} and {other}")


def _number(value: float) -> Value:
    """A constant."""
    if isinstance(value, bool):
        return Value("i1", ("true" if value else "false",))
    if isinstance(value, int):
        return Value("i64", (str(value),))
    (bits,) = struct.unpack("<Q", struct.pack("<d", value))
    return Value("double", (f"0x{bits:016X}",))


def _constant(value: Any) -> Value:
    """A number or a tuple of constants."""
    if isinstance(value, tuple):
        return _tuple([_constant(item) for item in value], getattr(value, "_fields", ()))
    return _number(value)


def _tuple(items: Sequence[Value], fields: tuple[str, ...] = ()) -> Value:
    leaves = tuple(leaf for item in items for leaf in item.leaves)
    return Value(TupleType(tuple(item.type for item in items), fields), leaves)


def _items(value: Value) -> list[Value]:
    """The items of a tuple."""
    items, at = [], 0
    for item in value.type.items:
        size = len(leaf_types(item))
        items.append(Value(item, value.leaves[at : at + size]))
        at += size
    return items


LIBRARY = frozenset("acos asin atan atan2 cos cosh exp log pow sin sinh tan tanh fmod".split())
"""Functions of C's library."""

INTRINSICS = frozenset("sqrt fabs copysign floor ceil".split())
"""Operations of LLVM, which are exact."""

ARITHMETIC: dict[type, tuple[str, str]] = {
    ast.Add: ("fadd", "add"),
    ast.Sub: ("fsub", "sub"),
    ast.Mult: ("fmul", "mul"),
    ast.BitAnd: ("", "and"),
    ast.BitOr: ("", "or"),
}
ORDER: dict[type, tuple[str, str]] = {
    ast.Eq: ("oeq", "eq"),
    ast.NotEq: ("une", "ne"),
    ast.Lt: ("olt", "slt"),
    ast.LtE: ("ole", "sle"),
    ast.Gt: ("ogt", "sgt"),
    ast.GtE: ("oge", "sge"),
}


class Part(NamedTuple):
    """A function as LLVM's code: its signature, how it is defined, what it calls and declares."""

    signature: str
    """The type of the result, the name, and the types of the arguments with their names."""
    declaration: str
    """The same without names of arguments."""
    lines: tuple[str, ...]
    inline: bool
    """Whether it becomes part of its callers; it calls no other then."""
    calls: frozenset[str]
    outside: frozenset[str]
    """Declarations of what is in no program, and definitions of tables of constants."""


class Translation:
    """The functions of a program, translated as they are called."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.found: dict[tuple[str, tuple[Any, ...]], tuple[str, Any]] = {}
        self.parts: dict[str, Part] = {}
        self.names: dict[str, str] = {}
        """The functions' names in the program by those in LLVM's code."""

    def function(self, name: str, types: tuple[Any, ...]) -> tuple[str, Any]:
        """The LLVM name and the type of the result of a function for arguments of these types."""
        if (name, types) not in self.found:
            known: dict[str, Any] = {}
            widened = True
            while widened:
                body = Body(self, self.program.trees[name], types, known)
                lines, known, widened = body.translate(), body.known, body.widened
            like = sum(other == name for other in self.names.values())
            own = f"@f_{name}_{like}"
            result = known.get(RESULT, NOTHING)
            kinds = ", ".join(leaf for of in types for leaf in leaf_types(of))
            head = f"fastcc {_struct(leaf_types(result))} {own}"
            inline = len(body.lines) <= SHORT and not body.calls
            self.parts[own] = Part(
                f"{head}({body.arguments})",
                f"{head}({kinds})",
                tuple(lines),
                inline,
                frozenset(body.calls),
                frozenset(body.outside),
            )
            self.names[own], self.found[name, types] = name, (own, result)
        return self.found[name, types]

    def modules(self, arguments: str) -> list[str]:
        """The modules of the program, one for each of the origins of its functions, which are
        compiled by themselves; the first has the function ``entry``, which takes arrays of these
        kinds, as pointers and sizes, and the functions that have no origin.

        Raises NotImplementedError for what is not in the subset.
        """
        types, names, at = [], [], 0
        for kind in arguments:
            types.append(ViewType(*POINTERS[kind]))
            for leaf in leaf_types(types[-1]):
                names.append(f"{leaf} %a{at}")
                at += 1
        name, result = self.function("entry", tuple(types))
        if result != "i64":
            raise NotImplementedError(f"entry returns {result}")
        entry = f"""define i64 @{ENTRY}({", ".join(names)}) nounwind {{
  %r = call fastcc i64 {name}({", ".join(names)})
  ret i64 %r
}}"""
        parts: dict[str, list[str]] = {"": []}
        for part, own in self.names.items():
            parts.setdefault(self.program.origins.get(own, ""), []).append(part)
        first = parts.pop("")
        copied = {part for part, found in self.parts.items() if found.inline}.difference(first)
        others = [some for _, some in sorted(parts.items()) if not copied.issuperset(some)]
        return [self._module(first, copied, entry), *(self._module(o, copied) for o in others)]

    def _module(self, own: Sequence[str], copied: Set[str], *entry: str) -> str:
        """A module of some of the functions, and of those it calls that are copied to callers.

        A function written for a model is not copied: its callers' modules are the same for all."""
        called = {other for part in own for other in self.parts[part].calls}
        lent = {
            other for part, found in self.parts.items() if part not in own for other in found.calls
        }
        written = sorted({*own, *(called & copied)})
        outside = {text for part in written for text in self.parts[part].outside}
        lacking = sorted(called - {*written})
        declared = [f"declare hidden {self.parts[part].declaration}" for part in lacking]
        texts = []
        for part in written:
            found = self.parts[part]
            linkage = "hidden" if part in lent - copied else "internal"
            how = "nounwind" + " alwaysinline" * found.inline
            how += " noimplicitfloat" * (self.names[part] in self.program.closed)
            texts.append(
                "\n".join([f"define {linkage} {found.signature} {how} {{", *found.lines, "}"])
            )
        return "\n\n".join([*sorted(outside), *declared, *texts, *entry]) + "\n"


SHORT = 300
"""Lines of a function up to which it becomes part of its callers if it calls no other: sums over
the orders of a series are faster for the places that they then know."""

RESULT = "return"
"""Stands for the result among a function's variables: no variable has this name."""


def _struct(leaves: Sequence[str]) -> str:
    if not leaves:
        return "void"
    return leaves[0] if len(leaves) == 1 else f"{{ {', '.join(leaves)} }}"


class Body:
    """One function for arguments of given types.

    `known` has the types of variables, as an earlier translation found them.
    """

    def __init__(
        self,
        translation: Translation,
        tree: ast.FunctionDef,
        types: tuple[Any, ...],
        known: Mapping[str, Any],
    ) -> None:
        self.translation, self.program, self.tree = translation, translation.program, tree
        self.known = dict(known)
        self.widened = False
        self.lines: list[str] = []
        self.slots: list[str] = []
        self.places: dict[str, tuple[str, ...]] = {}
        self.functions: dict[str, Value] = {}
        self.count = 0
        self.live = True
        self.calls: set[str] = set()
        """The functions of the program that it calls."""
        self.outside: set[str] = set()
        """Declarations and tables of constants that it needs."""
        self.loops: list[tuple[str, str]] = []
        names = [argument.arg for argument in tree.args.args]
        if len(names) != len(types):
            raise NotImplementedError(f"{tree.name} takes {len(names)} arguments: {len(types)}")
        given = []
        for name, of in zip(names, types, strict=True):
            own = [(leaf, self._new()) for leaf in leaf_types(of)]
            given += [f"{leaf} {value}" for leaf, value in own]
            self._assign(name, Value(of, tuple(value for _, value in own)))
        self.arguments = ", ".join(given)

    def translate(self) -> list[str]:
        """The lines of the function's body."""
        self._block(self.tree.body)
        if self.live:
            self._return(Value(NOTHING, ()))
        return ["entry:", *self.slots, *self.lines]

    # Lines, labels and slots

    def _new(self) -> str:
        self.count += 1
        return f"%v{self.count}"

    def _put(self, text: str) -> str:
        """Add an instruction; returns the name of its result."""
        name = self._new()
        self.lines.append(f"  {name} = {text}")
        return name

    def _do(self, text: str) -> None:
        self.lines.append(f"  {text}")

    def _labels(self, *names: str) -> list[str]:
        self.count += 1
        return [f"{name}{self.count}" for name in names]

    def _begin(self, label: str) -> None:
        self.lines.append(f"{label}:")
        self.live = True

    def _go(self, label: str) -> None:
        """Go on at a label, if this place is reached at all."""
        if self.live:
            self._do(f"br label %{label}")
        self.live = False

    def _branch(self, condition: str, true: str, false: str) -> None:
        self._do(f"br i1 {condition}, label %{true}, label %{false}")
        self.live = False

    def _slot(self, of: str) -> str:
        name = self._new()
        self.slots.append(f"  {name} = alloca {of}")
        return name

    # Variables

    def _assign(self, name: str, value: Value) -> None:
        if isinstance(value.type, FunctionType):
            self.functions[name] = value
        if isinstance(value.type, FunctionType) or name == "_":
            return
        of = self._widen(name, value.type)
        leaves = leaf_types(of)
        places = self.places.setdefault(name, tuple(self._slot(leaf) for leaf in leaves))
        for leaf, number, place in zip(leaves, self._as(value, of).leaves, places, strict=True):
            self._do(f"store {leaf} {number}, ptr {place}")

    def _widen(self, name: str, of: Any) -> Any:
        """Join a type to that of a variable; if it changes, the function is translated again."""
        before = self.known.setdefault(name, of)
        self.known[name] = _join(before, of)
        if self.known[name] != before:
            self.widened = True
            self.places.pop(name, None)
        return self.known[name]

    def _load(self, name: str) -> Value:
        leaves = leaf_types(self.known[name])
        pairs = zip(leaves, self.places[name], strict=True)
        return Value(self.known[name], tuple(self._put(f"load {x}, ptr {at}") for x, at in pairs))

    def _load_field(self, name: str, field: str) -> Value:
        """One item of a named tuple."""
        of = self.known[name]
        items = _items(Value(of, self.places[name]))
        kind, places = items[of.fields.index(field)]
        pairs = zip(leaf_types(kind), places, strict=True)
        return Value(kind, tuple(self._put(f"load {x}, ptr {at}") for x, at in pairs))

    def _as(self, value: Value, of: Any) -> Value:
        """A value as one of another type."""
        if value.type == of:
            return value
        if isinstance(of, TupleType):
            pairs = zip(_items(value), of.items, strict=True)
            return _tuple([self._as(item, kind) for item, kind in pairs], of.fields)
        (number,) = value.leaves
        if of == "i64" and value.type == "i1":
            return Value(of, (self._put(f"zext i1 {number} to i64"),))
        if of == "double" and value.type in ("i64", "i1"):
            if number.lstrip("-").isdigit():
                return _number(float(number))
            how = "sitofp" if value.type == "i64" else "uitofp"
            return Value(of, (self._put(f"{how} {value.type} {number} to double"),))
        raise NotImplementedError(f"{value.type} where {of} is expected in {self.tree.name}")

    # Statements

    def _block(self, statements: Sequence[ast.stmt]) -> None:
        for statement in statements:
            if not self.live:
                return
            name = f"_{type(statement).__name__}"
            if not hasattr(self, name):
                raise NotImplementedError(f"{ast.unparse(statement)} in {self.tree.name}")
            getattr(self, name)(statement)

    def _Expr(self, node: ast.Expr) -> None:
        self.value(node.value)

    def _Pass(self, node: ast.Pass) -> None:
        pass

    def _Return(self, node: ast.Return) -> None:
        self._return(Value(NOTHING, ()) if node.value is None else self.value(node.value))

    def _return(self, value: Value) -> None:
        of = self._widen(RESULT, value.type)
        leaves, given = leaf_types(of), self._as(value, of).leaves
        if len(leaves) > 1:
            whole = "undef"
            for i, (leaf, number) in enumerate(zip(leaves, given, strict=True)):
                whole = self._put(f"insertvalue {_struct(leaves)} {whole}, {leaf} {number}, {i}")
            given = (whole,)
        self._do(f"ret {_struct(leaves)} {given[0] if leaves else ''}".rstrip())
        self.live = False

    def _Assign(self, node: ast.Assign) -> None:
        value = self.value(node.value)
        for target in node.targets:
            self._set(target, value)

    def _AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self._set(node.target, self.value(node.value))

    def _AugAssign(self, node: ast.AugAssign) -> None:
        if isinstance(node.target, ast.Name):
            before = self._load(node.target.id)
            self._assign(node.target.id, self._operate(node.op, before, self.value(node.value)))
            return
        place, of = self._place(node.target)
        value = Value(of, (self._put(f"load {of}, ptr {place}"),))
        value = self._as(self._operate(node.op, value, self.value(node.value)), of)
        self._do(f"store {of} {value.leaves[0]}, ptr {place}")

    def _set(self, target: ast.expr, value: Value) -> None:
        if isinstance(target, ast.Name):
            self._assign(target.id, value)
        elif isinstance(target, ast.Tuple):
            for part, item in zip(target.elts, self._unpack(value, len(target.elts)), strict=True):
                self._set(part, item)
        else:
            place, of = self._place(target)
            self._do(f"store {of} {self._as(value, of).leaves[0]}, ptr {place}")

    def _unpack(self, value: Value, count: int) -> list[Value]:
        if isinstance(value.type, ViewType):
            return [self._item(value, [_number(i)]) for i in range(count)]
        return _items(value)

    def _If(self, node: ast.If) -> None:
        then, other, after = self._labels("then", "else", "after")
        self._branch(self._truth(self.value(node.test)), then, other)
        reached = False
        for label, statements in ((then, node.body), (other, node.orelse)):
            self._begin(label)
            self._block(statements)
            reached = reached or self.live
            self._go(after)
        if reached:
            self._begin(after)

    def _While(self, node: ast.While) -> None:
        top, inside, after = self._labels("while", "do", "done")
        self._go(top)
        self._begin(top)
        self._branch(self._truth(self.value(node.test)), inside, after)
        self._begin(inside)
        self.loops.append((top, after))
        self._block(node.body)
        self.loops.pop()
        self._go(top)
        self._begin(after)

    def _For(self, node: ast.For) -> None:
        whole = None
        if isinstance(node.iter, ast.Call) and ast.unparse(node.iter.func) == "range":
            given = [self._as(self.value(one), "i64").leaves[0] for one in node.iter.args]
            start, stop, step = (["0", *given, "1"], [*given, "1"], given)[len(given) - 1]
        else:
            whole = self.value(node.iter)
            start, stop, step = "0", self._len([whole]).leaves[0], "1"
        compare = "sgt" if int(step) < 0 else "slt"
        at = self._slot("i64")
        top, inside, following, after = self._labels("for", "do", "next", "done")
        self._do(f"store i64 {start}, ptr {at}")
        self._go(top)
        self._begin(top)
        i = self._put(f"load i64, ptr {at}")
        self._branch(self._put(f"icmp {compare} i64 {i}, {stop}"), inside, after)
        self._begin(inside)
        index = Value("i64", (i,))
        self._set(node.target, self._item(whole, [index]) if whole else index)
        self.loops.append((following, after))
        self._block(node.body)
        self.loops.pop()
        self._go(following)
        self._begin(following)
        last = self._put(f"load i64, ptr {at}")
        self._do(f"store i64 {self._put(f'add i64 {last}, {step}')}, ptr {at}")
        self._go(top)
        self._begin(after)

    def _Break(self, node: ast.Break) -> None:
        self._go(self.loops[-1][1])

    def _Continue(self, node: ast.Continue) -> None:
        self._go(self.loops[-1][0])

    # Expressions

    def value(self, node: ast.expr) -> Value:
        """Translate an expression."""
        found = getattr(self, f"_value_{type(node).__name__}", None)
        if found is None:
            raise NotImplementedError(f"{ast.unparse(node)} in {self.tree.name}")
        value: Value = found(node)
        return value

    def _value_Constant(self, node: ast.Constant) -> Value:
        return _constant(node.value)

    def _value_Name(self, node: ast.Name) -> Value:
        name = node.id
        if name in self.functions:
            return self.functions[name]
        if name in self.places:
            return self._load(name)
        if name in self.program.trees or name in OPERATIONS:
            return Value(FunctionType(name), ())
        if name not in self.program.constants:
            raise NotImplementedError(f"{name} has no value yet in {self.tree.name}")
        constant = self.program.constants[name]
        return Value(FunctionType(name), ()) if isinstance(constant, type) else _constant(constant)

    def _value_Attribute(self, node: ast.Attribute) -> Value:
        if isinstance(node.value, ast.Name) and node.value.id == "math":
            found = getattr(math, node.attr)
            return Value(FunctionType(node.attr), ()) if callable(found) else _number(found)
        if isinstance(node.value, ast.Name) and node.value.id in self.places:
            return self._load_field(node.value.id, node.attr)
        value = self.value(node.value)
        return _items(value)[value.type.fields.index(node.attr)]

    def _value_Tuple(self, node: ast.Tuple) -> Value:
        return _tuple([self.value(item) for item in node.elts])

    def _value_BinOp(self, node: ast.BinOp) -> Value:
        return self._operate(node.op, self.value(node.left), self.value(node.right))

    def _value_UnaryOp(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return Value("i1", (self._put(f"xor i1 {self._truth(value)}, true"),))
        if not isinstance(node.op, ast.USub):
            raise NotImplementedError(f"{ast.unparse(node)} in {self.tree.name}")
        if value.type == "double":
            return Value("double", (self._put(f"fneg double {value.leaves[0]}"),))
        (number,) = self._as(value, "i64").leaves
        minus = f"-{number}" if number.isdigit() else self._put(f"sub i64 0, {number}")
        return Value("i64", (minus,))

    def _value_Compare(self, node: ast.Compare) -> Value:
        left, found = self.value(node.left), ""
        for operation, following in zip(node.ops, node.comparators, strict=True):
            right = self.value(following)
            order = ORDER.get(type(operation))
            of = _join(left.type, right.type)
            if order is None or of not in ("double", "i64", "i1"):
                raise NotImplementedError(f"{ast.unparse(node)} in {self.tree.name}")
            (a,), (b,) = self._as(left, of).leaves, self._as(right, of).leaves
            how = f"fcmp {order[0]}" if of == "double" else f"icmp {order[1]}"
            new = self._put(f"{how} {of} {a}, {b}")
            found = self._put(f"and i1 {found}, {new}") if found else new
            left = right
        return Value("i1", (found,))

    def _value_BoolOp(self, node: ast.BoolOp) -> Value:
        """One of the operands: what follows is looked at only where it decides."""
        name = f"{type(node.op).__name__} {node.lineno}:{node.col_offset}"
        (after,) = self._labels("after")
        for operand in node.values[:-1]:
            value = self.value(operand)
            self._assign(name, value)
            (following,) = self._labels("following")
            on, out = (following, after) if isinstance(node.op, ast.And) else (after, following)
            self._branch(self._truth(value), on, out)
            self._begin(following)
        self._assign(name, self.value(node.values[-1]))
        self._go(after)
        self._begin(after)
        return self._load(name)

    def _value_IfExp(self, node: ast.IfExp) -> Value:
        name = f"if {node.lineno}:{node.col_offset}"
        then, other, after = self._labels("then", "else", "after")
        self._branch(self._truth(self.value(node.test)), then, other)
        for label, chosen in ((then, node.body), (other, node.orelse)):
            self._begin(label)
            self._assign(name, self.value(chosen))
            self._go(after)
        self._begin(after)
        return self._load(name)

    def _value_Subscript(self, node: ast.Subscript) -> Value:
        whole = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self._part(whole, node)
        chosen = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        return self._item(whole, [self.value(index) for index in chosen])

    def _part(self, whole: Value, node: ast.Subscript) -> Value:
        """A slice of a tuple, or of the first rows of an array."""
        assert isinstance(node.slice, ast.Slice)
        if node.slice.step is not None:
            raise NotImplementedError(f"{ast.unparse(node)} in {self.tree.name}")
        if isinstance(whole.type, TupleType):
            lowest, beyond = (self._known(b) for b in (node.slice.lower, node.slice.upper))
            return _tuple(_items(whole)[lowest:beyond])
        place, size, *sizes = whole.leaves
        first = self._bound(node.slice.lower, size, "0")
        last = self._bound(node.slice.upper, size, size)
        last = self._select("slt", last, first, first, last)
        start = first
        for other in sizes:
            start = self._put(f"mul nsw i64 {start}, {other}")
        left = self._put(f"sub i64 {last}, {first}")
        return Value(whole.type, (self._at(whole.type.number, place, start), left, *sizes))

    def _known(self, node: ast.expr | None) -> int | None:
        """A bound of a slice of a tuple, which has to be a constant."""
        if node is None:
            return None
        (number,) = self.value(node).leaves
        if not number.lstrip("-").isdigit():
            raise NotImplementedError(f"{ast.unparse(node)} bounds a tuple in {self.tree.name}")
        return int(number)

    def _bound(self, node: ast.expr | None, size: str, absent: str) -> str:
        """A bound of a slice, from 0 to the size."""
        if node is None:
            return absent
        bound = self._wrap(self._as(self.value(node), "i64").leaves[0], size)
        bound = self._select("slt", bound, "0", "0", bound)
        return self._select("slt", bound, size, bound, size)

    def _select(self, order: str, a: str, b: str, then: str, other: str) -> str:
        condition = self._put(f"icmp {order} i64 {a}, {b}")
        return self._put(f"select i1 {condition}, i64 {then}, i64 {other}")

    def _item(self, whole: Value, indices: Sequence[Value]) -> Value:
        """An item of a tuple or of an array, or a row of a table."""
        if isinstance(whole.type, ViewType):
            place, of, sizes = self._address(whole, indices)
            if sizes:
                return Value(ViewType(of, len(sizes)), (place, *sizes))
            return Value(of, (self._put(f"load {of}, ptr {place}"),))
        (index,) = self._as(indices[0], "i64").leaves
        items = _items(whole)
        if index.lstrip("-").isdigit():
            return items[int(index)]
        of = functools.reduce(_join, whole.type.items)
        columns = zip(*(self._as(item, of).leaves for item in items), strict=True)
        index = self._wrap(index, str(len(items)))
        leaves = []
        for leaf, numbers in zip(leaf_types(of), columns, strict=True):
            at = self._at(leaf, self._column(leaf, numbers), index)
            leaves.append(self._put(f"load {leaf}, ptr {at}"))
        return Value(of, tuple(leaves))

    def _column(self, leaf: str, numbers: Sequence[str]) -> str:
        """The address of numbers side by side; constants are stored once for all calls."""
        if not any(number.startswith("%") for number in numbers):
            items = ", ".join(f"{leaf} {number}" for number in numbers)
            text = f"private unnamed_addr constant [{len(numbers)} x {leaf}] [{items}]"
            name = f"@t_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
            self.outside.add(f"{name} = {text}")
            return name
        table = self._slot(f"[{len(numbers)} x {leaf}]")
        for i, number in enumerate(numbers):
            self._do(f"store {leaf} {number}, ptr {self._at(leaf, table, str(i))}")
        return table

    def _place(self, target: ast.expr) -> tuple[str, str]:
        """The address of an element that is assigned to, and its type."""
        if not isinstance(target, ast.Subscript) or isinstance(target.slice, ast.Slice):
            raise NotImplementedError(f"{ast.unparse(target)} is assigned to in {self.tree.name}")
        whole, chosen = self.value(target.value), target.slice
        given = chosen.elts if isinstance(chosen, ast.Tuple) else [chosen]
        if not isinstance(whole.type, ViewType) or len(given) != whole.type.dimensions:
            raise NotImplementedError(f"{ast.unparse(target)} is assigned to in {self.tree.name}")
        return self._address(whole, [self.value(index) for index in given])[:2]

    def _address(self, view: Value, indices: Sequence[Value]) -> tuple[str, str, tuple[str, ...]]:
        """The address of an element or a row of an array, its type, and a row's sizes."""
        place, *sizes = view.leaves
        for number in indices:
            size, *sizes = sizes
            index = self._wrap(self._as(number, "i64").leaves[0], size)
            for other in sizes:
                index = self._put(f"mul nsw i64 {index}, {other}")
            place = self._at(view.type.number, place, index)
        return place, view.type.number, tuple(sizes)

    def _at(self, of: str, place: str, index: str) -> str:
        return self._put(f"getelementptr inbounds {of}, ptr {place}, i64 {index}")

    def _wrap(self, index: str, size: str) -> str:
        """An index, where a negative one counts from the end."""
        if index.isdigit():
            return index
        return self._select("slt", index, "0", self._put(f"add i64 {index}, {size}"), index)

    def _truth(self, value: Value) -> str:
        if value.type == "i1":
            return value.leaves[0]
        if value.type == "double":
            return self._put(f"fcmp une double {value.leaves[0]}, 0.0")
        if value.type == "i64":
            return self._put(f"icmp ne i64 {value.leaves[0]}, 0")
        raise NotImplementedError(f"the truth of {value.type} in {self.tree.name}")

    # Operations

    def _operate(self, operation: ast.operator, a: Value, b: Value) -> Value:
        if isinstance(a.type, TupleType) or isinstance(b.type, TupleType):
            return self._operate_on_tuples(operation, a, b)
        of = _join(_join(a.type, b.type), "i64")
        if isinstance(operation, ast.Div):
            of = "double"
        if of == "double" and isinstance(operation, ast.Mod):
            return self._modulo(a, b)
        if isinstance(operation, ast.Pow):
            return self.call("pow", [a, b])
        (x,), (y,) = self._as(a, of).leaves, self._as(b, of).leaves
        if isinstance(operation, ast.Div):
            return Value(of, (self._put(f"fdiv double {x}, {y}"),))
        if isinstance(operation, ast.Mod | ast.FloorDiv) and of == "i64":
            return Value(of, (self._divide(isinstance(operation, ast.Mod), x, y),))
        names = ARITHMETIC.get(type(operation), ("", ""))
        name = names[of == "i64"]
        if not name:
            raise NotImplementedError(f"{type(operation).__name__} of {of} in {self.tree.name}")
        return Value(of, (self._put(f"{name} {of} {x}, {y}"),))

    def _operate_on_tuples(self, operation: ast.operator, a: Value, b: Value) -> Value:
        if isinstance(operation, ast.Add):
            return _tuple([*_items(a), *_items(b)])
        if isinstance(operation, ast.Mult) and b.leaves[0].isdigit():
            return _tuple(_items(a) * int(b.leaves[0]))
        raise NotImplementedError(f"{type(operation).__name__} of tuples in {self.tree.name}")

    def _modulo(self, a: Value, b: Value) -> Value:
        """Python's remainder of floats: it has the sign of the divisor."""
        (x,), (y,) = self._as(a, "double").leaves, self._as(b, "double").leaves
        zero = _number(0.0).leaves[0]
        rest = self.call("fmod", [Value("double", (x,)), Value("double", (y,))]).leaves[0]
        signed = self.call("copysign", [_number(0.0), Value("double", (y,))]).leaves[0]
        signs = [self._put(f"fcmp olt double {number}, {zero}") for number in (rest, y)]
        differ = self._put(f"xor i1 {signs[0]}, {signs[1]}")
        moved = self._put(f"fadd double {rest}, {y}")
        moved = self._put(f"select i1 {differ}, double {moved}, double {rest}")
        none = self._put(f"fcmp oeq double {rest}, {zero}")
        return Value("double", (self._put(f"select i1 {none}, double {signed}, double {moved}"),))

    def _divide(self, remainder: bool, x: str, y: str) -> str:
        """Python's quotient or remainder of whole numbers: towards minus infinity."""
        if not y.isdigit():  # a division by zero, which has no value, must not end the process
            y = self._select("eq", y, "0", "1", y)
        rest, quotient = self._put(f"srem i64 {x}, {y}"), self._put(f"sdiv i64 {x}, {y}")
        crossed = self._put(f"icmp slt i64 {self._put(f'xor i64 {rest}, {y}')}, 0")
        uneven = self._put(f"and i1 {self._put(f'icmp ne i64 {rest}, 0')}, {crossed}")
        moved = self._put(f"add i64 {rest}, {y}" if remainder else f"sub i64 {quotient}, 1")
        return self._put(f"select i1 {uneven}, i64 {moved}, i64 {rest if remainder else quotient}")

    # Calls

    def _value_Call(self, node: ast.Call) -> Value:
        function = self.value(node.func)
        if node.keywords or not isinstance(function.type, FunctionType):
            raise NotImplementedError(f"{ast.unparse(node)} in {self.tree.name}")
        given = []
        for argument in node.args:
            if isinstance(argument, ast.Starred):
                given += _items(self.value(argument.value))
            else:
                given.append(self.value(argument))
        return self.call(function.type.name, given)

    def call(self, name: str, given: Sequence[Value]) -> Value:
        """The value of a function of the program, of Python or of `math`."""
        if name in self.program.trees:
            return self._call_own(name, given)
        if name in self.program.constants:
            fields = self.program.constants[name]._fields
            return _tuple(given, fields)
        if name in OPERATIONS:
            return OPERATIONS[name](self, given)
        found = self._call_library(name, given)
        return self._int([found]) if name in ("floor", "ceil") else found

    def _call_library(self, name: str, given: Sequence[Value]) -> Value:
        numbers = [f"double {self._as(value, 'double').leaves[0]}" for value in given]
        kinds = ", ".join("double" for _ in given)
        if name in INTRINSICS:
            own = f"@llvm.{name}.f64"
        elif name in LIBRARY:
            own = f"@{name}"
        else:
            raise NotImplementedError(f"{name} is called in {self.tree.name}")
        pure = "" if name in INTRINSICS else " nounwind memory(none)"
        self.outside.add(f"declare double {own}({kinds}){pure}")
        return Value("double", (self._put(f"call double {own}({', '.join(numbers)})"),))

    def _call_own(self, name: str, given: Sequence[Value]) -> Value:
        own, result = self.translation.function(name, tuple(value.type for value in given))
        self.calls.add(own)
        numbers = ", ".join(
            f"{leaf} {number}"
            for value in given
            for leaf, number in zip(leaf_types(value.type), value.leaves, strict=True)
        )
        leaves = leaf_types(result)
        if not leaves:
            self._do(f"call fastcc void {own}({numbers})")
            return Value(result, ())
        found = self._put(f"call fastcc {_struct(leaves)} {own}({numbers})")
        if len(leaves) == 1:
            return Value(result, (found,))
        take = f"extractvalue {_struct(leaves)} {found}"
        return Value(result, tuple(self._put(f"{take}, {i}") for i in range(len(leaves))))

    def _len(self, given: Sequence[Value]) -> Value:
        (whole,) = given
        if isinstance(whole.type, ViewType):
            return Value("i64", (whole.leaves[1],))
        return _number(len(whole.type.items))

    def _tail(self, given: Sequence[Value]) -> Value:
        """The part of a vector from a place on that it is taken to have."""
        (place, size), start = given[0].leaves, self._as(given[1], "i64").leaves[0]
        left = self._put(f"sub i64 {size}, {start}")
        return Value(given[0].type, (self._at(given[0].type.number, place, start), left))

    def _abs(self, given: Sequence[Value]) -> Value:
        (value,) = given
        if value.type == "double":
            return self.call("fabs", given)
        (number,) = self._as(value, "i64").leaves
        minus = self._put(f"sub i64 0, {number}")
        return Value("i64", (self._select("slt", number, "0", minus, number),))

    def _extreme(self, given: Sequence[Value], orders: tuple[str, str]) -> Value:
        """The largest or smallest number; a later one only if it is beyond those before."""
        best, *others = _items(given[0]) if len(given) == 1 else given
        for other in others:
            of = _join(_join(best.type, other.type), "i64")
            (a,), (b,) = self._as(best, of).leaves, self._as(other, of).leaves
            how = f"fcmp {orders[0]}" if of == "double" else f"icmp {orders[1]}"
            beyond = self._put(f"{how} {of} {b}, {a}")
            best = Value(of, (self._put(f"select i1 {beyond}, {of} {b}, {of} {a}"),))
        return best

    def _int(self, given: Sequence[Value]) -> Value:
        (value,) = given
        if value.type != "double":
            return self._as(value, "i64")
        self.outside.add("declare i64 @llvm.fptosi.sat.i64.f64(double)")
        whole = self._put(f"call i64 @llvm.fptosi.sat.i64.f64(double {value.leaves[0]})")
        return Value("i64", (whole,))


OPERATIONS: dict[str, Callable[[Body, Sequence[Value]], Value]] = {
    "len": Body._len,
    "abs": Body._abs,
    "tail": Body._tail,
    "int": Body._int,
    "float": lambda body, given: body._as(given[0], "double"),
    "bool": lambda body, given: Value("i1", (body._truth(given[0]),)),
    "max": lambda body, given: body._extreme(given, ("ogt", "sgt")),
    "min": lambda body, given: body._extreme(given, ("olt", "slt")),
}
"""Functions of Python."""
