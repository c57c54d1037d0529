"""Stress test of programs' truth: every form of a program has the reference evaluator's value on every scene.

Random typed programs, some of them mutated or with wrong types, are compared on empty, tower, full and odd scenes:
generated code, the compiled instructions of batched environments, the canonical form, the printed text, and prefix
tokens. The grammar below is written by hand, independently of the tables by which the evaluators work.
"""

import random
import re
from collections import Counter
from itertools import islice

from lilgym_mp.programs import Program, ProgramError, ProgramRuntimeError, compile_program
from lilgym_mp.programs.canonical import canonical_form
from lilgym_mp.programs.prefix import PrefixError, prefix_tokens, tree_from_tokens
from lilgym_mp.programs.printing import source_of
from lilgym_mp.programs.syntax import MAX_LENGTH, parse
from lilgym_mp.programs.task import Task
from lilgym_mp.scene import BOX_COUNT, Colour, Item, Scene, Shape, Size
from tests.envs.alike import started_core
from tests.scenes import tower

BATCH = 40  # programs evaluated together in compiled cores
DEPTHS = (1, 2, 3, 3, 4, 5)
LEAVES = 0.15  # probability of a form without parts
VARIABLES = 0.5  # probability of a variable, where one of that type is bound
WRONG_TYPES = 0.02  # probability that a part has another type than its place requires
WORDS_AS_FUNCTIONS = 0.15
MUTATED = 0.1  # share of the programs from which text is deleted, or in which it is duplicated

# By type: the forms of its expressions. {type} is a part, {item:bool} a function from items to bools.
GRAMMAR = {
    "bool": """True; False; exist({items}); exist({items}); exist({boxes}); exist({colors}); exist({pairs});
        AND({bool}, {bool}); OR({bool}, {bool}); OR({bool}, {bool}); NOT({bool}); (not {truth}); (not {bool});
        ({bool} and {bool}); ({bool} or {bool}); ({truth} and {truth} and {bool}); ({bool} or {truth} or {bool});
        ({int} == {int}); ({int} != {int}); ({int} < {int}); ({int} >= {int}); ({int} <= {int} < {int});
        ({item} == {item}); ({box} == {box}); ({box} != {box}); ({color} == {color}); ({color} != {color});
        ({shape} == {shape}); ({items} == {items}); ({colors} == {colors}); ({boxes} == {boxes}); ({bool} == {bool});
        ({item} in {items}); ({item} not in {items}); ({color} in {colors}); ({box} in {boxes}); ({int} in [1, 2]);
        le({int}, {int}); ge({int}, {int}); lt({int}, {int}); gt({int}, {int}); equal_int({int}, {int});
        member_of({item}, {items}); member_of({color}, {colors}); contained({items}, {items});
        contained({colors}, {colors}); equal_set({items}, {items}); equal_set({colors}, {colors});
        equal({items}, {items}); equal({int}, {int}); equal({item}, {items}); equal({color}, {color});
        equal({color}, {colors}); equal_color({color}, {color}); equal_color({colors}, {colors});
        equal_color({color}, {colors}); equal_shape({shape}, {shape}); equal_size({size}, {size});
        All({items}, {item:bool}); All({items}, {item:truth}); All({boxes}, {box:bool}); All({colors}, {color:bool});
        All({pairs}, {pair:bool}); Any({items}, {item:bool}); Any({items}, {item:truth}); Any({boxes}, {box:bool});
        Any({boxes}, {box:truth}); Any({colors}, {color:bool}); Any({pairs}, {pair:bool}); all([{bool}, {truth}]);
        all_same({colors}); all_same_color({items}); all_same_shape({items}); all_same_size({items});
        all_same_attribute({items}, {item:color}); all_same_attribute({boxes}, {box:int});
        all_same_attribute({boxes}, {box:bool}); all_same_attribute({colors}, {color:int});
        is_yellow({item}); is_blue({item}); is_black({item}); is_circle({item}); is_square({item});
        is_triangle({item}); is_big({item}); is_medium({item}); is_small({item}); is_top({item}); is_bottom({item});
        is_second({item}); is_third({item}); is_touching_wall({item}); is_touching_wall({item}, {side});
        is_closely_touching_wall({item}, side={side}); is_close_to_wall({item}, {side}); is_touching_corner({item});
        is_closely_touching_corner({item}, {side}); is_closely_touching_specific_corner({item}, {side}, {side});
        is_close_to_corner({item}); is_closely_touching({item}, {item}); {box}.is_tower(); {box}.is_tower()""",
    "truth": "{bool}; {bool}; {bool}; {bool}; {bool}; {items}; {items}; {boxes}; {box}; {int}; {colors}",
    "int": """0; 1; 1; 2; 3; 5; count({items}); count({items}); count({boxes}); count({colors}); count({pairs});
        len({items}); len({boxes}); len({colors}); ({int} + {int}); ({int} % 2); ({int} % {int})""",
    "item": """all_items[0]; all_items[1]; {items}[0]; {items}[1]; unique({items}); unique({items});
        min({items}, key={item:int}); {pair}[0]; {pair}[1]""",
    "items": """all_items; all_items; {box}; {box}.all_items_in_box(); filter_obj({items}, {item:bool});
        filter_obj({items}, {item:bool}); filter_obj({items}, {item:truth}); filter_color({items}, {color});
        filter_color({items}, {color}); filter_shape({items}, {shape}); filter_size({items}, {size});
        union({items}, {items}); intersect({items}, {items}); set({items}); ({items} + {items}); {items}[0:2];
        {items}[1:]; get_touching({item}); get_touching({items}); get_closely_touching({item}); get_above({item});
        get_above({items}); get_below({item}); get_below({items}); get_box_all_above({item});
        get_box_all_below({items}); get_img_all_above({item}); get_img_all_below({items}); get_box_inclusive({item});
        get_box_exclusive({item}); get_box_exclusive({items}); get_img_exclusive({item}); [{item}, {item}]; {{{item}}};
        {pair}; union_all([{items}, {items}]); intersect_all([{items}, {items}]); union_all({boxes})""",
    "box": "all_boxes[0]; all_boxes[1]; all_boxes[2]; {item}.box; {boxes}[0]; min({boxes}, key={box:int})",
    "boxes": """all_boxes; all_boxes; all_boxes; filter_obj({boxes}, {box:bool}); filter_obj({boxes}, {box:truth});
        set({boxes}); union({boxes}, {boxes}); intersect({boxes}, {boxes}); [{box}, {box}]; {{{box}, {box}}};
        ({boxes} + {boxes}); {boxes}[0:2]""",
    "color": "Color.YELLOW; Color.BLACK; Color.BLUE; {item}.color; {item}.color; unique({colors}); {colors}[0]",
    "shape": "Shape.CIRCLE; Shape.SQUARE; Shape.TRIANGLE; {item}.shape",
    "size": "Size.SMALL; Size.MEDIUM; Size.BIG; {item}.size",
    "side": "Side.TOP; Side.BOTTOM; Side.LEFT; Side.RIGHT; Side.ANY",
    "colors": """query_color({items}); query_color({item}); get_set_colors({items}); [{color}, {color}]; [{color}];
        {{{color}, {color}}}; set({colors}); union({colors}, {colors}); intersect({colors}, {colors});
        filter_obj({colors}, {color:bool})""",
    "pair": "{pairs}[0]; unique({pairs})",
    "pairs": """combinations({items}, 2); combinations({items}, 2); combinations(all_boxes, 2); select(2, {items});
        filter_obj({pairs}, {pair:bool}); combinations({boxes}, 2)""",
}
FORMS = {kind: [form.strip() for form in text.split(";")] for kind, text in GRAMMAR.items()}
FORMS["pair"].append("combinations(all_items, 2)[0]")  # the only form without parts
SIMPLE_FORMS = {kind: [form for form in forms if "{" not in form.replace("{{", "")] for kind, forms in FORMS.items()}
SIMPLE_FORMS |= {"truth": ["True", "all_items"], "colors": ["[Color.BLUE]"], "pairs": ["combinations(all_items, 2)"]}
ITEM_TESTS = ("is_blue", "is_square", "is_big", "is_top", "is_touching_wall", "is_touching_corner")
RELATIONS = ("get_touching", "get_above", "get_box_exclusive")
FUNCTION_WORDS = {
    "item:bool": ITEM_TESTS,
    "item:truth": (*ITEM_TESTS, *RELATIONS),
    "box:truth": ("exist", "count", "set"),
}
_PART = re.compile(r"(?<!\{)\{([a-z:]+)\}")


class TypedPrograms:
    """Random programs of the grammar."""

    def __init__(self, rng):
        self._rng = rng

    def program(self):
        """A program that the parser accepts."""
        while True:
            source = self._expression("bool", self._rng.choice(DEPTHS), (), whole=True)
            try:
                parse(source)
            except ProgramError:  # too long or too deep
                continue
            return source

    def _expression(self, kind, depth, bound, *, whole=False):
        rng = self._rng
        if rng.random() < WRONG_TYPES:
            kind = rng.choice(list(FORMS))
        names = [name for name, of in dict(bound).items() if of == kind]
        if names and rng.random() < VARIABLES:
            return rng.choice(names)
        simple = depth <= 0 or (not whole and rng.random() < LEAVES)
        form = rng.choice((SIMPLE_FORMS if simple else FORMS)[kind])
        text = _PART.sub(lambda match: self._part(match[1], depth - 1, bound), form)
        return text.replace("{{", "{").replace("}}", "}")

    def _part(self, wanted, depth, bound):
        parameter, _, result = wanted.partition(":")
        if not result:
            return self._expression(wanted, depth, bound)
        if self._rng.random() < WORDS_AS_FUNCTIONS and wanted in FUNCTION_WORDS:
            return self._rng.choice(FUNCTION_WORDS[wanted])
        name = self._rng.choice("xyzb")
        return f"lambda {name}: {self._expression(result, depth, (*bound, (name, parameter)))}"


def scenes(rng):
    """An empty scene, one with towers, one of few items, a full one, and an odd one."""
    size = rng.choice(list(Size))
    free = range(101 - size.pixels)
    boxes = [[_item(rng, rng.choice(free), rng.choice(free), size) for _ in range(rng.randrange(4))] for _ in range(3)]
    full = [[_item(rng, x, y, Size.SMALL) for x in range(0, 40, 10) for y in (0, 10)] for _ in range(BOX_COUNT)]
    odd = [
        [_item(rng, rng.choice((-2, 0, 4, 80, 101)), 50) for _ in range(rng.choice((0, 1, 3, 26)))] for _ in range(2)
    ]
    return (
        Scene.empty(),
        Scene.of(*(tower(*rng.choices(list(Colour), k=rng.randrange(5))) for _ in range(BOX_COUNT))),
        Scene.of(*boxes),
        Scene.of(*full),
        Scene.of(*odd, odd[0]),
    )


def _item(rng, x, y, size=None):
    return Item(x, y, rng.choice(list(Shape)), rng.choice(list(Colour)), size or rng.choice(list(Size)))


def mutated(rng, source):
    """The text with some substrings deleted or duplicated."""
    for _ in range(rng.randint(1, 3)):
        a, b = sorted(rng.randrange(len(source) + 1) for _ in "ab")
        piece = source[a : min(b, a + 12)]
        source = rng.choice((source[:a] + source[b:][:2_000], source[:b] + piece + source[b:])) or "x"
    return source


def value(program, scene, *, reference=False):
    """The program's value, or its error message."""
    try:
        return program.evaluate_reference(scene) if reference else program.evaluate(scene)
    except ProgramRuntimeError as fault:
        return str(fault)


def differences(program, probes, expected):
    """Disagreements with the reference evaluator's values, except in batches."""
    generated = ("generated code", "generated code, again") if program.has_generated_code else ()
    for scene, wanted in zip(probes, expected, strict=True):
        for attempt in generated:  # the second time from the boxes' memos
            if (found := value(program, scene)) != wanted:
                yield f"{attempt} gives {found}, not {wanted}, on {scene}"
    if parse(source_of(program.tree)) != program.tree:
        yield f"printed as {source_of(program.tree)}, which is another program"
    form = canonical_form(program.tree)
    text = source_of(form)
    if canonical_form(form) != form:
        yield f"canonical form {text} has the canonical form {source_of(canonical_form(form))}"
    if len(text) <= MAX_LENGTH:
        if parse(text) != form:
            yield f"canonical form printed as {text}, which is another program"
        canonical = Program(text)
        for scene, wanted in zip(probes, expected, strict=True):
            found = value(canonical, scene, reference=True)
            if found != wanted and {type(found), type(wanted)} != {str}:
                yield f"canonical form {text} gives {found}, not {wanted}, on {scene}"
    try:
        tokens = prefix_tokens(form)
    except PrefixError:
        return
    if tree_from_tokens(tokens) != form:
        yield f"tokens {' '.join(tokens)} are another program than {text}"


def batch_differences(appearance, cases):
    """Disagreements of compiled cores, in which an error counts as false, with the reference evaluator."""
    tasks = [Task("own", "It is so.", source, True, scene) for source, scene, _ in cases]
    core, buffers = started_core(appearance, tasks, horizon=1)
    core.write_goals()
    for (source, scene, wanted), found in zip(cases, buffers.goal.tolist(), strict=True):
        if found != (wanted is True):
            yield f"{source}: a batch of {appearance} gives {bool(found)}, not {wanted}, on {scene}"


def compare(count, seed):
    """Compares all forms of `count` random programs. Returns what was compared, and the disagreements."""
    rng = random.Random(seed)
    generator = TypedPrograms(rng)
    compared = Counter()
    found = []
    for first in range(0, count, BATCH):
        cases = {"tower": [], "scatter": []}
        for _ in range(min(BATCH, count - first)):
            source = generator.program()
            try:
                program = compile_program(mutated(rng, source) if rng.random() < MUTATED else source)
            except ProgramError:
                compared["refused"] += 1
                continue
            probes = scenes(rng)
            source = program.source
            values = [value(program, scene, reference=True) for scene in probes]
            found.extend(f"{source}: {difference}" for difference in islice(differences(program, probes, values), 1))
            judged = list(zip([source] * len(probes), probes, values, strict=True))
            cases["tower"].extend(judged[:2])
            cases["scatter"].extend(judged[2:-1])  # the odd scene is not for the arrays of a core
            compared["programs"] += 1
            compared["with generated code"] += program.has_generated_code
            compared["true"] += values.count(True)
            compared["false"] += values.count(False)
            compared["errors"] += sum(isinstance(each, str) for each in values)
        for appearance, chosen in cases.items():
            found.extend(batch_differences(appearance, chosen))
    return compared, found
