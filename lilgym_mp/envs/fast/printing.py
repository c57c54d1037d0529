"""Writes the code of programs as Python source, and compiles it to functions of a scene or of a box."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakValueDictionary

from lilgym_mp.envs.fast import box_functions, ir
from lilgym_mp.scene import Scene

MAX_TEXT = 20_000  # characters of a function's source
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
    """The function of a scene whose value is the code's. Raises Unsupported if its source is too long."""
    printer = _Printer(looks_up_kernels=not _has_loops(code))
    text, boxes = printer.text(code), ", ".join(ir.BOXES)
    source = f"def evaluate(scene):\n    {boxes} = scene.boxes\n{printer.lines('    ')}    return bool({text})\n"
    return _compiled(source, printer.names, "evaluate")


def kernel(code: ir.Code) -> ir.Kernel:
    """The kernel with that code, shared by all programs that contain it. Raises Unsupported."""
    printer = _Printer(looks_up_kernels=False)
    text, box = printer.text(code), ir.LOCAL_BOX
    lines = printer.lines("        ")
    key = f"program kernel {lines}{text}"
    known = _KERNELS.get(key)
    if known is None:
        source = (
            f"def kernel({box}):\n    value = {box}.memo.get(key)\n    if value is None:\n"
            f"        check_size({box})\n{lines}        value = {box}.memo[key] = {text}\n    return value\n"
        )
        printer.names["key"] = key
        known = _KERNELS[key] = ir.Kernel(key, _compiled(source, printer.names, "kernel"), code)
    return known


def _compiled(source: str, names: dict[str, Any], name: str) -> Callable[[Any], Any]:
    """Executes generated source and returns the function it defines. No user-written text is in the source."""
    if len(source) > MAX_TEXT:
        ir.unsupported("too long")
    exec(compile(source, f"<{name} of a program>", "exec"), names)
    return names[name]


def _has_loops(code: ir.Code) -> bool:
    return isinstance(code, ir.Where | ir.TupleCount) or any(map(_has_loops, code.parts))


class _Printer:
    """Prints code of one function: `names` are its globals, `lines` what is computed before its loops."""

    def __init__(self, *, looks_up_kernels: bool) -> None:
        """`looks_up_kernels`: look up the value of a kernel in the box's memo before calling it; not within loops."""
        self.names: dict[str, Any] = dict(box_functions.NAMES)
        self._looks_up_kernels = looks_up_kernels
        self._hoisted: dict[str, str] = {}  # calls of vectorised words within loops, by the variable with their value
        self._kernels: dict[ir.Kernel, str] = {}

    def lines(self, indent: str) -> str:
        return "".join(f"{indent}{name} = {text}\n" for name, text in self._hoisted.items())

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
        name, function = call.name, call.function
        if call.kernel is not None:
            name = self._kernels.setdefault(call.kernel, f"kernel{len(self._kernels)}")
            self.names |= {f"{name}_key": call.kernel.key, f"{name}_object": call.kernel}
        self.names[name] = function
        text = f"{name}({call.box})"
        if call.kernel is None and in_loop:
            self._hoisted[f"{name}_{call.box}"] = text
            return f"{name}_{call.box}"
        if call.kernel is not None and self._looks_up_kernels:
            return f"(v if (v := {call.box}.memo.get({name}_key)) is not None else {text})"
        return text


def _applied(operator: str, operands: list[str]) -> str:
    if operator == "occurring":
        return f"occurring({', '.join(operands)})"
    if operator in CALLS:
        return CALLS[operator].format(*operands)
    if " " not in operator:
        return f"({f' {operator} '.join(operands)})"
    compared = zip(operator.split(), operands[1:], strict=True)
    return f"({' '.join([operands[0], *(f'{sign} {operand}' for sign, operand in compared)])})"


_KERNELS: WeakValueDictionary[str, ir.Kernel] = WeakValueDictionary()  # by source
