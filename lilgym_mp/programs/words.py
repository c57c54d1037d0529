"""The `@word` decorator: registers a typed Python function as a word (built-in function) of the program language.

A word is declared by its function's annotations and docstring alone. Each annotation is one of the parameter types
below, which checks the argument and coerces it: a collection, for example, becomes a list in scene order. Arguments of
the wrong type raise ProgramRuntimeError.
"""

from __future__ import annotations

import functools
import inspect
import sys
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, cast, get_args, get_type_hints

from lilgym_mp.programs import costs
from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.values import BoxView, Color, ItemView, Shape, Side, Size
from lilgym_mp.scene.choices import article, load_extensions

Function = TypeVar("Function", bound=Callable[..., Any])
Argument = TypeVar("Argument")
Dependency = Literal["attributes", "position", "item", "box", "scene"]
Failure = Literal["never", "unhashable elements", "some values"]
GROUPS = (
    "sets",
    "item tests",
    "walls",
    "two items",
    "related items",
    "attributes",
    "comparison",
    "logic",
    "built-ins",
)


class WordError(TypeError):
    """The decorated function cannot be registered as a word."""


class ArgumentTypeError(Exception):
    """The argument is not of the parameter's type."""


@dataclass(frozen=True)
class ParameterType:
    """`coerce` returns the normalised argument or raises ArgumentTypeError; `name` appears in signatures and errors."""

    name: str
    coerce: Callable[[Any], Any]
    mapped: bool = False  # call the function once per item and return the union of the results


def is_collection(value: object) -> bool:
    """Whether words accept the value as a collection; a box is one, of its items."""
    return isinstance(value, list | tuple | set | frozenset | BoxView)


def elements(value: Iterable[Any]) -> list[Any]:
    """The elements of a collection as a list; a set is sorted into scene order so that programs are deterministic."""
    if isinstance(value, set | frozenset):
        return sorted(cast("set[Any]", value), key=_scene_order)
    return list(value)


def _scene_order(value: Any) -> tuple[Any, ...]:
    if isinstance(value, ItemView):
        return (0, value.box.index, value.index)
    if isinstance(value, BoxView):
        return (1, value.index)
    if isinstance(value, Enum):
        return (2, type(value).__name__, value.value)
    if isinstance(value, int):
        return (3, value)
    if isinstance(value, tuple):
        parts = cast("tuple[Any, ...]", value)
        return (4, len(parts), tuple(map(_scene_order, parts)))
    return (5, value.order) if isinstance(value, FunctionValue) else (6, value.__self__.index, value.__name__)


class FunctionValue:
    """A lambda or a word used as a value. `order` is its sort key among functions in a set."""

    __slots__ = ("call", "order")

    def __init__(self, call: Callable[[Any], Any], order: tuple[int | str, ...]) -> None:
        self.call = call
        self.order = order

    def __call__(self, value: Any) -> Any:
        return self.call(value)


def identity_key(value: Any) -> Hashable:
    """Key for counting distinct objects: numbers and attributes by value, everything else by identity."""
    return (type(value), value) if isinstance(value, int | Enum) else id(value)


def value_key(value: Any) -> Hashable:
    """A hashable key, equal for equal values; lists and sets are allowed."""
    if isinstance(value, list | tuple):
        return (type(cast("object", value)), tuple(map(value_key, cast("Iterable[Any]", value))))
    if isinstance(value, set | frozenset):
        return (set, frozenset(map(value_key, cast("Iterable[Any]", value))))
    return value


def describe(value: object) -> str:
    """The value as text for an error message."""
    if isinstance(value, ItemView):
        return f"item {value.index} of box {value.box.index}"
    if isinstance(value, BoxView):
        return f"box {value.index}"
    if isinstance(value, Enum):
        return str(value)
    if isinstance(value, bool | int):
        return f"{type(value).__name__} {value}"
    if isinstance(value, list | tuple | set | frozenset):
        contents = cast("list[Any]", value)
        return f"a {type(contents).__name__} of {len(contents)}"
    return "a function"


def _instance(expected: type) -> Callable[[Any], Any]:
    def coerce(value: Any) -> Any:
        if type(value) is not expected:
            raise ArgumentTypeError
        return value

    return coerce


def _collection(value: Any) -> list[Any]:
    if not is_collection(value):
        raise ArgumentTypeError
    return elements(value)


def _items(value: Any) -> list[Any]:
    found = _collection(value)
    if any(type(item) is not ItemView for item in found):
        raise ArgumentTypeError
    return found


def _item_or_items(value: Any) -> list[Any]:
    return [value] if type(value) is ItemView else _items(value)


def _collections(value: Any) -> list[list[Any]]:
    return [_collection(part) for part in _collection(value)]


def _function(value: Any) -> Any:
    if not isinstance(value, FunctionValue):
        raise ArgumentTypeError
    return value


def _any(value: Any) -> Any:
    return value


def _enum_values(expected: type[Enum]) -> Callable[[Any], Any]:
    """Accepts a member of the enum or a collection of members."""

    def coerce(value: Any) -> Any:
        found = elements(value) if is_collection(value) else [value]
        if any(type(part) is not expected for part in found):
            raise ArgumentTypeError
        return value

    return coerce


AnyArg = Annotated[Any, ParameterType("value", _any)]
BoolArg = Annotated[bool, ParameterType("bool", _instance(bool))]
IntArg = Annotated[int, ParameterType("int", _instance(int))]
ItemArg = Annotated[ItemView, ParameterType("item", _instance(ItemView))]
EachItemArg = Annotated[ItemView, ParameterType("item or collection of items", _item_or_items, mapped=True)]
ItemOrItemsArg = Annotated[list[ItemView], ParameterType("item or collection of items", _item_or_items)]
ItemsArg = Annotated[list[ItemView], ParameterType("collection of items", _items)]
CollectionArg = Annotated[list[Any], ParameterType("collection", _collection)]
CollectionsArg = Annotated[list[list[Any]], ParameterType("collection of collections", _collections)]
FunctionArg = Annotated[Callable[[Any], Any], ParameterType("function", _function)]
ColorArg = Annotated[Color, ParameterType("Color", _instance(Color))]
ShapeArg = Annotated[Shape, ParameterType("Shape", _instance(Shape))]
SizeArg = Annotated[Size, ParameterType("Size", _instance(Size))]
SideArg = Annotated[Side, ParameterType("Side", _instance(Side))]
ColorsArg = Annotated[Any, ParameterType("Color or collection of Colors", _enum_values(Color))]
ShapesArg = Annotated[Any, ParameterType("Shape or collection of Shapes", _enum_values(Shape))]
SizesArg = Annotated[Any, ParameterType("Size or collection of Sizes", _enum_values(Size))]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a word, with the check of its values."""

    name: str
    type: ParameterType
    default: Any = inspect.Parameter.empty
    keyword_only: bool = False

    @property
    def optional(self) -> bool:
        """Whether calls may leave it out."""
        return self.default is not inspect.Parameter.empty

    def __str__(self) -> str:
        return f"{self.name}: {self.type.name}" + (f" = {self.default}" if self.optional else "")


class ResultSize(NamedTuple):
    """Size of a list of k-subsets of a collection, computed before the list is built."""

    subsets: int
    subset_size: int  # k
    collection_size: int

    def element_count(self, collection_elements: int) -> int:
        """Elements at all nesting levels of the result, given those of the collection."""
        return self.subsets * (1 + self.subset_size * -(-collection_elements // max(1, self.collection_size)))


@dataclass(frozen=True, eq=False)
class Word:
    """A word of the language, with all that is known about it; calling it coerces the arguments first.

    `depends_on`: what the value for an item depends on: its attributes (colour, shape, size), its position (and
    size), both ("item"), its box, or the whole scene.
    `steps_per_element`: evaluation cost per element of the arguments.
    `result_size`: computes the size of a result that can be larger than the arguments, else None.
    `fails_on`: on which arguments of the parameters' types it raises an error.
    `operator`: the operator of Python with the same values, if there is one.
    `attribute`: "color", "shape" or "size" if the word has a form for each of them, such as `query_color`.
    `reads_order`: whether the value may depend on the order of items.
    """

    name: str
    function: Callable[..., Any]
    group: str
    parameters: tuple[Parameter, ...]
    result: str
    depends_on: Dependency
    steps_per_element: int
    result_size: Callable[..., ResultSize] | None
    fails_on: Failure
    operator: str
    attribute: str
    reads_order: bool

    @property
    def form(self) -> str:
        """The name, with {} instead of the attribute."""
        return self.name.replace(self.attribute, "{}") if self.attribute else self.name

    @property
    def may_read_positions(self) -> bool:
        """Whether the value may depend on where items are."""
        return self.is_extension or self.group in ("item tests", "walls", "two items", "related items")

    @property
    def depends_on_item_only(self) -> bool:
        """Whether the value for an item is independent of its box and scene."""
        return self.depends_on in ("attributes", "position", "item")

    @property
    def is_extension(self) -> bool:
        """Whether it is not a word of this package, so that only what it declares is known about it."""
        return not self.function.__module__.startswith("lilgym_mp.")

    @property
    def signature(self) -> str:
        """The word with its parameters and result, as vocabulary tables show it."""
        shown = list(map(str, self.parameters))
        first_keyword_only = [index for index, parameter in enumerate(self.parameters) if parameter.keyword_only][:1]
        for index in first_keyword_only:
            shown.insert(index, "*")
        return f"{self.name}({', '.join(shown)}) -> {self.result}"

    @property
    def meaning(self) -> str:
        """The docstring of the word's function."""
        return inspect.getdoc(self.function) or ""

    def steps(self, element_count: int, item_count: int) -> int:
        """Cost of a call, given the elements in its arguments (all levels) and the items in the scene."""
        per_pair = costs.PAIR * item_count if self.depends_on in ("box", "scene") else 0
        return costs.CALL + element_count * (self.steps_per_element + per_pair)

    @property
    def is_item_test(self) -> bool:
        """Whether the word is a predicate of one item that depends on nothing beyond its box but sides, if given."""
        types = [parameter.type.name for parameter in self.parameters]
        one_item = types[:1] == ["item"] and set(types[1:]) <= {"Side"}
        return one_item and self.result == "bool" and self.depends_on != "scene"

    def bind(self, positional: Sequence[Argument], keywords: Mapping[str, Argument]) -> tuple[Argument | None, ...]:
        """The argument of each parameter, None for the default.

        Raises TypeError for missing, unknown, repeated or surplus arguments.
        """
        given = self._python_signature.bind(*positional, **keywords).arguments
        return tuple(given.get(parameter.name) for parameter in self.parameters)

    @functools.cached_property
    def _python_signature(self) -> inspect.Signature:
        return inspect.signature(self.function)

    def __call__(self, *args: Any) -> Any:
        coerced = self.coerce(args)
        if not self.parameters or not self.parameters[0].type.mapped:
            return self.function(*coerced)
        union: set[Any] = set()
        for item in coerced[0]:
            union |= self.function(item)
        return union

    def coerce(self, args: tuple[Any, ...]) -> list[Any]:
        """The arguments checked and coerced, with defaults filled in."""
        parameters = self.parameters
        if len(args) > len(parameters):
            raise ProgramRuntimeError(f"{self.name}: {len(args)} arguments are too many")
        coerced: list[Any] = []
        for parameter, value in zip(parameters, args, strict=False):
            try:
                coerced.append(parameter.type.coerce(value))
            except ArgumentTypeError:
                expected = f"{self.name}: {parameter.name} must be {article(parameter.type.name)}"
                raise ProgramRuntimeError(f"{expected}, not {describe(value)}") from None
        for parameter in parameters[len(args) :]:
            if not parameter.optional:
                raise ProgramRuntimeError(f"{self.name}: argument {parameter.name!r} is missing")
            coerced.append(parameter.default)
        return coerced


WORDS: dict[str, Word] = {}


def word(
    group: str,
    *,
    depends_on: Dependency = "item",
    name: str | None = None,
    steps_per_element: int = 2,
    result_size: Callable[..., ResultSize] | None = None,
    fails_on: Failure = "never",
    operator: str = "",
    attribute: str = "",
    reads_order: bool = False,
) -> Callable[[Function], Function]:
    """Registers the decorated function as a word; `name` overrides the function's name where that would shadow a
    Python built-in.

    The other arguments are fields of `Word`.

    Raises WordError for an unknown group, dependency or `fails_on`, a name already taken, a parameter that is variadic
    or not annotated with one of the parameter types above, and a function without a docstring or return annotation.
    """
    declared = {
        "group": (group, GROUPS),
        "depends_on": (depends_on, get_args(Dependency)),
        "fails_on": (fails_on, get_args(Failure)),
    }
    for option, (value, choices) in declared.items():
        if value not in choices:
            raise WordError(f"unknown {option} {value!r}; choose from {', '.join(choices)}")

    def declare(function: Function) -> Function:
        called = name or cast("Any", function).__name__
        if called in WORDS:
            raise WordError(f"word {called} is already defined in {WORDS[called].function.__module__}")
        if not inspect.getdoc(function) and sys.flags.optimize < 2:  # `python -OO` removes docstrings
            raise WordError(f"word {called} needs a docstring, which becomes its documentation")
        hints = get_type_hints(function, include_extras=True)
        if "return" not in hints:
            raise WordError(f"word {called} needs a return annotation")
        parameters = tuple(
            Parameter(
                parameter.name,
                _parameter_type(called, parameter, hints.get(parameter.name)),
                parameter.default,
                parameter.kind is parameter.KEYWORD_ONLY,
            )
            for parameter in inspect.signature(function).parameters.values()
        )
        WORDS[called] = Word(
            name=called,
            function=_positional_only(function, parameters),
            group=group,
            parameters=parameters,
            result=_result_name(hints["return"]),
            depends_on=depends_on,
            steps_per_element=steps_per_element,
            result_size=result_size,
            fails_on=fails_on,
            operator=operator,
            attribute=attribute,
            reads_order=reads_order,
        )
        return function

    return declare


def known_words(name: str) -> Mapping[str, Word]:
    """The words by name, with those of extensions if `name` is not among the others."""
    if name not in WORDS:
        load_extensions()
    return WORDS


register_word = word  # called so by other packages


def _positional_only(function: Callable[..., Any], parameters: tuple[Parameter, ...]) -> Callable[..., Any]:
    """The function with its keyword-only parameters taken by position."""
    names = [parameter.name for parameter in parameters if parameter.keyword_only]
    if not names:
        return function

    def call(*args: Any) -> Any:
        split = len(args) - len(names)
        return function(*args[:split], **dict(zip(names, args[split:], strict=True)))

    return functools.update_wrapper(call, function)


def _parameter_type(word: str, parameter: inspect.Parameter, annotation: Any) -> ParameterType:
    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
        raise WordError(f"word {word} cannot take variadic arguments such as {parameter}")
    parts = (part for union in (annotation, *get_args(annotation)) for part in get_args(union))
    found = next((part for part in parts if isinstance(part, ParameterType)), None)
    if found is None:
        choices = ", ".join(sorted(name for name, value in globals().items() if _is_parameter_annotation(value)))
        raise WordError(f"argument {parameter.name!r} of word {word} must be annotated with one of {choices}")
    return found


def _is_parameter_annotation(value: object) -> bool:
    return any(isinstance(part, ParameterType) for part in get_args(value))


def _result_name(annotation: Any) -> str:
    if annotation is Any:
        return "value"
    text = annotation.__name__ if isinstance(annotation, type) and not get_args(annotation) else str(annotation)
    for module in ("lilgym_mp.programs.values.", "typing."):
        text = text.replace(module, "")
    return text.replace("ItemView", "item").replace("Any", "value")
