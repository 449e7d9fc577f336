"""Kernels that call `flow`, as they are compiled: with scratch space, where it puts its tables."""

from __future__ import annotations

import ast

from ..segments.arithmetic import Kernel, kernel_of
from ..segments.compiled_flow import space_of
from ..segments.kernels import Kernels


def space_for(kernels: Kernels) -> int:
    """Return how many numbers of scratch space the flights of a model take; 0 for none."""
    values = kernels.model.values.values()
    start = [0.0] * kernels.model.unknowns_per_impact
    linear = [guard.name for guard in kernels.model.WALLS if kernels.linear(guard.name)]
    shapes = [kernels.law(name)(*start, *values)[:2] for name in linear]
    return max((space_of(int(d), int(h), len(kernels.parameters)) for d, h in shapes), default=0)


def with_space(kernel: Kernel) -> Kernel:
    """Return a kernel with scratch space as its last argument, which it hands on to `flow`.

    The numbers of the flow are put at the beginning of the space, instead of being arguments.

    Raises
    ------
    NotImplementedError
        For a kernel with two flows: the second would overwrite what the first has found.
    """
    tree = ast.parse(kernel.text)
    (function,) = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    function.args.args.append(ast.arg("space"))
    body: list[ast.stmt] = []
    flows = 0
    for statement in function.body:
        call = getattr(statement, "value", None)
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "flow":
            flows += 1
            for i, number in enumerate(call.args[4:]):
                body += ast.parse(f"space[{i}] = {ast.unparse(number)}").body
            call.args[4:] = [ast.Name("space", ast.Load())]
        body.append(statement)
    if flows > 1:
        raise NotImplementedError(f"{kernel.__name__} has {flows} flows")
    function.body = body
    text = ast.unparse(ast.fix_missing_locations(tree))
    return kernel_of(kernel.__name__, text, f"<{kernel.__name__} with space>")
