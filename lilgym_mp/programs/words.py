"""How a typed Python function becomes a word of the program language.

`@word(group)` reads a function's annotations and docstring: they are the only declaration of the word. The
annotations are the kinds below; a kind checks an argument and brings it into the one form its functions
work on (a collection becomes a list in scene order). Wrong arguments raise ProgramRuntimeError.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, cast, get_args, get_type_hints

from lilgym_mp.programs import costs
from lilgym_mp.programs.errors import ProgramRuntimeError
from lilgym_mp.programs.views import BoxView, Color, ItemView, Shape, Side, Size

Function = TypeVar("Function", bound=Callable[..., Any])
Dependency = Literal["attributes", "position", "item", "box", "scene"]
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
    """A function that cannot become a word; says why."""


class KindError(Exception):
    """An argument of the wrong kind."""


@dataclass(frozen=True)
class Kind:
    """A kind of argument: its name for people, and `take`, which checks and normalises a value."""

    name: str
    take: Callable[[Any], Any]
    each: bool = False  # the function is called for each item and the results are united


def is_collection(value: object) -> bool:
    return isinstance(value, list | tuple | set | frozenset | BoxView)


def elements(value: Iterable[Any]) -> list[Any]:
    """The elements of a collection; those of a set in scene order, so that programs are deterministic."""
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
    """A lambda or a word as a value of a program. `order` tells where it comes in a set."""

    __slots__ = ("call", "order")

    def __init__(self, call: Callable[[Any], Any], order: tuple[int | str, ...]) -> None:
        self.call = call
        self.order = order

    def __call__(self, value: Any) -> Any:
        return self.call(value)


def identity(value: Any) -> Hashable:
    """What makes a value one object among others: numbers and attributes by value, all else by identity."""
    return (type(value), value) if isinstance(value, int | Enum) else id(value)


def value_key(value: Any) -> Hashable:
    """A key that is equal for equal values, lists and sets included."""
    if isinstance(value, list | tuple):
        return (type(cast("object", value)), tuple(map(value_key, cast("Iterable[Any]", value))))
    if isinstance(value, set | frozenset):
        return (set, frozenset(map(value_key, cast("Iterable[Any]", value))))
    return value


def described(value: object) -> str:
    """A value for an error message."""
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


def _instance(kind: type) -> Callable[[Any], Any]:
    def take(value: Any) -> Any:
        if type(value) is not kind:
            raise KindError
        return value

    return take


def _collection(value: Any) -> list[Any]:
    if not is_collection(value):
        raise KindError
    return elements(value)


def _items(value: Any) -> list[Any]:
    found = _collection(value)
    if any(type(item) is not ItemView for item in found):
        raise KindError
    return found


def _item_or_items(value: Any) -> list[Any]:
    return [value] if type(value) is ItemView else _items(value)


def _collections(value: Any) -> list[list[Any]]:
    return [_collection(part) for part in _collection(value)]


def _function(value: Any) -> Any:
    if not isinstance(value, FunctionValue):
        raise KindError
    return value


def _any(value: Any) -> Any:
    return value


def values_of(kind: type[Enum]) -> Callable[[Any], Any]:
    """Takes a value of the enum, or a collection of them."""

    def take(value: Any) -> Any:
        found = elements(value) if is_collection(value) else [value]
        if any(type(part) is not kind for part in found):
            raise KindError
        return value

    return take


Value = Annotated[Any, Kind("value", _any)]
Boolean = Annotated[bool, Kind("bool", _instance(bool))]
Integer = Annotated[int, Kind("int", _instance(int))]
AnItem = Annotated[ItemView, Kind("item", _instance(ItemView))]
EachItem = Annotated[ItemView, Kind("item or collection of items", _item_or_items, each=True)]
ItemOrItems = Annotated[list[ItemView], Kind("item or collection of items", _item_or_items)]
Items = Annotated[list[ItemView], Kind("collection of items", _items)]
Elements = Annotated[list[Any], Kind("collection", _collection)]
Collections = Annotated[list[list[Any]], Kind("collection of collections", _collections)]
AFunction = Annotated[Callable[[Any], Any], Kind("function", _function)]
AColor = Annotated[Color, Kind("Color", _instance(Color))]
AShape = Annotated[Shape, Kind("Shape", _instance(Shape))]
ASize = Annotated[Size, Kind("Size", _instance(Size))]
ASide = Annotated[Side, Kind("Side", _instance(Side))]
Colors = Annotated[Any, Kind("Color or collection of Colors", values_of(Color))]
Shapes = Annotated[Any, Kind("Shape or collection of Shapes", values_of(Shape))]
Sizes = Annotated[Any, Kind("Size or collection of Sizes", values_of(Size))]


@dataclass(frozen=True)
class Parameter:
    name: str
    kind: Kind
    default: Any = inspect.Parameter.empty
    keyword_only: bool = False

    @property
    def optional(self) -> bool:
        return self.default is not inspect.Parameter.empty

    def __str__(self) -> str:
        return f"{self.name}: {self.kind.name}" + (f" = {self.default}" if self.optional else "")


class Growth(NamedTuple):
    """How large a list of choices is."""

    elements: int
    each: int  # elements of each
    of: int  # elements chosen from

    def weight(self, chosen_from: int) -> int:
        """Elements at all levels, if what is chosen from has so many."""
        return self.elements * (1 + self.each * -(-chosen_from // max(1, self.of)))


@dataclass(frozen=True, eq=False)
class Word:
    """A word of the language; calling it checks the arguments first.

    `depends_on` says what the value for an item depends on: its attributes (colour, shape, size), its position (and
    size), both, its box, or the whole scene.
    `steps_each` is what an element of the arguments costs. `growth` tells how large the result is where it can
    exceed the arguments.
    """

    name: str
    function: Callable[..., Any]
    group: str
    parameters: tuple[Parameter, ...]
    result: str
    depends_on: Dependency
    steps_each: int
    growth: Callable[..., Growth] | None

    @property
    def is_of_item_alone(self) -> bool:
        """Whether the value for an item depends on nothing but the item."""
        return self.depends_on in ("attributes", "position", "item")

    @property
    def signature(self) -> str:
        stars = [index for index, parameter in enumerate(self.parameters) if parameter.keyword_only][:1]
        shown = list(map(str, self.parameters))
        for index in stars:
            shown.insert(index, "*")
        return f"{self.name}({', '.join(shown)}) -> {self.result}"

    @property
    def meaning(self) -> str:
        return inspect.getdoc(self.function) or ""

    def steps(self, weight: int, item_count: int) -> int:
        """How many steps a call is charged, for the elements of its arguments and the items of the scene."""
        others = costs.PAIR * item_count if self.depends_on in ("box", "scene") else 0
        return costs.CALL + weight * (self.steps_each + others)

    def bind(self, positional: int, keywords: Iterable[str]) -> tuple[int | str | None, ...]:
        """For each parameter where its argument is: a position, a keyword, or None for the default.

        Raises TypeError saying which arguments are missing, unknown or too many.
        """
        named = set(keywords)
        if len(named) != len(list(keywords)):
            raise TypeError("an argument is given twice")
        places: list[int | str | None] = []
        for index, parameter in enumerate(self.parameters):
            by_position = index < positional and not parameter.keyword_only
            if by_position and parameter.name in named:
                raise TypeError(f"argument {parameter.name!r} is given twice")
            if by_position:
                places.append(index)
            elif parameter.name in named:
                places.append(parameter.name)
            elif parameter.optional:
                places.append(None)
            else:
                raise TypeError(f"argument {parameter.name!r} is missing")
        unknown = named - {parameter.name for parameter in self.parameters}
        if unknown:
            raise TypeError(f"there is no argument {min(unknown)!r}")
        if sum(isinstance(place, int) for place in places) < positional:
            raise TypeError(f"{positional} arguments are too many")
        return tuple(places)

    def __call__(self, *args: Any) -> Any:
        taken = self.taken(args)
        if not self.parameters or not self.parameters[0].kind.each:
            return self.function(*taken)
        united: set[Any] = set()
        for item in taken[0]:
            united |= self.function(item)
        return united

    def taken(self, args: tuple[Any, ...]) -> list[Any]:
        """The arguments, checked and brought into the form the function works on, defaults filled in."""
        parameters = self.parameters
        if len(args) > len(parameters):
            raise ProgramRuntimeError(f"{self.name}: {len(args)} arguments are too many")
        taken: list[Any] = []
        for parameter, value in zip(parameters, args, strict=False):
            try:
                taken.append(parameter.kind.take(value))
            except KindError:
                expected = f"{self.name}: {parameter.name} must be {_article(parameter.kind.name)}"
                raise ProgramRuntimeError(f"{expected}, not {described(value)}") from None
        for parameter in parameters[len(args) :]:
            if not parameter.optional:
                raise ProgramRuntimeError(f"{self.name}: argument {parameter.name!r} is missing")
            taken.append(parameter.default)
        return taken


WORDS: dict[str, Word] = {}


def word(
    group: str,
    *,
    depends_on: Dependency = "item",
    name: str | None = None,
    steps_each: int = 2,
    growth: Callable[..., Growth] | None = None,
) -> Callable[[Function], Function]:
    """Makes the decorated function a word; `name` is for words that would hide a built-in of Python.

    Raises WordError for an unknown group or dependency, a name that is taken, an argument that is annotated with none
    of the kinds above or may be any number of arguments, and a function without a docstring or annotated result.
    """
    for what, value, choices in (("group", group, GROUPS), ("depends_on", depends_on, get_args(Dependency))):
        if value not in choices:
            raise WordError(f"unknown {what} {value!r}; choose from {', '.join(choices)}")

    def declare(function: Function) -> Function:
        called = name or cast("Any", function).__name__
        if called in WORDS:
            raise WordError(f"there is a word {called} already, in {WORDS[called].function.__module__}")
        if not inspect.getdoc(function):
            raise WordError(f"the word {called} needs a docstring: it is what the documentation says of it")
        hints = get_type_hints(function, include_extras=True)
        if "return" not in hints:
            raise WordError(f"the word {called} needs an annotation of its result")
        parameters = tuple(
            Parameter(
                given.name, _kind(called, given, hints.get(given.name)), given.default, given.kind is given.KEYWORD_ONLY
            )
            for given in inspect.signature(function).parameters.values()
        )
        result = _result_name(hints["return"])
        plain = _by_position(function, parameters)
        WORDS[called] = Word(called, plain, group, parameters, result, depends_on, steps_each, growth)
        return function

    return declare


def _by_position(function: Callable[..., Any], parameters: tuple[Parameter, ...]) -> Callable[..., Any]:
    names = [parameter.name for parameter in parameters if parameter.keyword_only]
    if not names:
        return function

    def call(*args: Any) -> Any:
        split = len(args) - len(names)
        return function(*args[:split], **dict(zip(names, args[split:], strict=True)))

    return functools.update_wrapper(call, function)


def _kind(word: str, parameter: inspect.Parameter, annotation: Any) -> Kind:
    """The kind that the parameter is annotated with."""
    if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
        raise WordError(f"the word {word} cannot take any number of arguments, as {parameter} does")
    parts = (part for union in (annotation, *get_args(annotation)) for part in get_args(union))
    kind = next((part for part in parts if isinstance(part, Kind)), None)
    if kind is None:
        kinds = ", ".join(sorted(name for name, value in globals().items() if _names_kind(value)))
        raise WordError(f"argument {parameter.name!r} of the word {word} must be annotated with one of {kinds}")
    return kind


def _names_kind(value: object) -> bool:
    return any(isinstance(part, Kind) for part in get_args(value))


def _result_name(annotation: Any) -> str:
    if annotation is Any:
        return "value"
    text = annotation.__name__ if isinstance(annotation, type) and not get_args(annotation) else str(annotation)
    for module in ("lilgym_mp.programs.views.", "typing."):
        text = text.replace(module, "")
    return text.replace("ItemView", "item").replace("Any", "value")


def _article(noun: str) -> str:
    return f"an {noun}" if noun[0] in "aeiou" else f"a {noun}"
