"""Writes the code of programs as Python source, and compiles it to functions of a scene or of a box."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakValueDictionary

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.scene import Scene

CALLS = {  # operators that are not written between their operands
    "not": "(not {})",
    "~": "~{}",
    "negative": "-({})",  # 0 or, if true, a mask of all bits
    "bit_count": "({}).bit_count()",
    "only": "only({})",
    "row": "{}[{}]",
    "union": "union({}, {})",
    "comb": "comb({}, {})",
}


def scene_function(code: ir.Code) -> Callable[[Scene], bool]:
    """The function of a scene whose value is the code's."""
    printer = _Printer()
    text = printer.text(code)
    boxes = ", ".join(ir.BOXES)
    source = f"def evaluate(scene):\n    {boxes} = scene.boxes\n{printer.lines()}    return bool({text})\n"
    return _compiled(source, printer.names, "evaluate")


def kernel(code: ir.Code) -> ir.Kernel:
    """The kernel with that code, shared by all programs that contain it."""
    printer = _Printer()
    text = printer.text(code)
    source = f"def kernel({ir.LOCAL_BOX}):\n{printer.lines()}    return {text}\n"
    known = _KERNELS.get(source)
    if known is None:
        compute = _compiled(source, printer.names, "kernel")
        known = _KERNELS[source] = ir.Kernel(box_functions.memoised(f"program {source}", compute), code)
    return known


def _compiled(source: str, names: dict[str, Any], name: str) -> Callable[[Any], Any]:
    """Executes generated source and returns the function it defines. No user-written text is in the source."""
    exec(compile(source, f"<{name} of a program>", "exec"), names)
    return names[name]


class _Printer:
    """Prints code of one function: `names` are its globals, `lines` what is computed before its loops."""

    def __init__(self) -> None:
        self.names: dict[str, Any] = dict(box_functions.NAMES)
        self._hoisted: dict[str, str] = {}  # calls of vectorised words within loops, by the variable with their value
        self._kernels: dict[ir.Kernel, str] = {}

    def lines(self) -> str:
        return "".join(f"    {name} = {text}\n" for name, text in self._hoisted.items())

    def text(self, code: ir.Code, *, in_loop: bool = False) -> str:
        def inner(part: ir.Code) -> str:
            return self.text(part, in_loop=in_loop)

        match code:
            case ir.Number(value=value):
                return str(value)
            case ir.LoopIndex(name=name):
                return name
            case ir.ItemCount(box=box):
                return f"len({box}.items)"
            case ir.BoxCall():
                return self._call(code, in_loop)
            case ir.ItemField(box=box, item=item, field=field):
                return f"{box}.items[{inner(item)}][{field}]"
            case ir.Where(index=index, mask=mask, condition=condition):
                condition = self.text(condition, in_loop=True)
                return f"sum([1 << {index} for {index} in bits({inner(mask)}) if {condition}])"
            case ir.TupleCount(loops=loops, condition=condition):
                fors = (f"for {', '.join(n)}, in choose(bits({inner(mask)}), {len(n)})" for n, mask in loops)
                return f"sum([1 {' '.join(fors)} if {self.text(condition, in_loop=True)}])"
            case ir.Apply(operator=operator, operands=operands):
                return _applied(operator, list(map(inner, operands)))
            case _:
                raise AssertionError(code)

    def _call(self, call: ir.BoxCall, in_loop: bool) -> str:
        name = f"word_{call.name}"
        function = call.function
        if call.kernel is not None:
            name = self._kernels.setdefault(call.kernel, f"kernel{len(self._kernels)}")
            self.names[f"{name}_object"] = call.kernel  # which keeps it alive, so that other programs share it
        self.names[name] = function
        text = f"{name}({call.box})"
        if call.kernel is None and in_loop:
            self._hoisted[f"{name}_{call.box}"] = text
            return f"{name}_{call.box}"
        return text


def _applied(operator: str, operands: list[str]) -> str:
    if operator in CALLS:
        return CALLS[operator].format(*operands)
    if " " not in operator:
        return f"({f' {operator} '.join(operands)})"
    compared = zip(operator.split(), operands[1:], strict=True)
    return f"({' '.join([operands[0], *(f'{sign} {operand}' for sign, operand in compared)])})"


_KERNELS: WeakValueDictionary[str, ir.Kernel] = WeakValueDictionary()  # by source
