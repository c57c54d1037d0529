"""Scenes for tests: helpers to write literal ones, and hypothesis strategies for random ones."""

from hypothesis import strategies as st

from lilgym_mp.scene import BOX_SIDE, Box, Colour, Item, Scene, Shape, Size
from lilgym_mp.scene.appearances.scatter.geometry import is_free

Y, K, B = Colour.YELLOW, Colour.BLACK, Colour.BLUE
SMALL, MEDIUM, LARGE = Size.SMALL, Size.MEDIUM, Size.LARGE

MAX_ITEMS = 8  # per box, as in the NLVR data


def circle(x, y, size=MEDIUM, colour=Y):
    return Item(x, y, Shape.CIRCLE, colour, size)


def square(x, y, size=MEDIUM, colour=Y):
    return Item(x, y, Shape.SQUARE, colour, size)


def triangle(x, y, size=MEDIUM, colour=Y):
    return Item(x, y, Shape.TRIANGLE, colour, size)


def tower(*colours):
    """Blocks in the given colours, bottom first."""
    return [square(40, 80 - 21 * level, colour=colour) for level, colour in enumerate(colours)]


NAMES = {member.name.lower(): member for kind in (Shape, Colour, Size) for member in kind}
LETTERS = {"y": Y, "k": K, "b": B}


def items_of(text):
    """Items such as "circle 0,70; square 40,80 large blue": medium and yellow unless said otherwise. "tower ykb" are
    blocks, bottom first: yellow, black and blue."""
    found = []
    for each in filter(None, map(str.strip, text.split(";"))):
        shape, where, *words = each.split()
        if shape == "tower":
            found += tower(*map(LETTERS.__getitem__, where))
            continue
        x, y = map(int, where.split(","))
        said = {type(NAMES[word]): NAMES[word] for word in words}
        found.append(Item(x, y, NAMES[shape], said.get(Colour, Y), said.get(Size, MEDIUM)))
    return found


def scene_of(text):
    """Boxes of `items_of`, separated by "|"; those to the right may be left out."""
    return scene(*map(items_of, text.split("|")))


def scene(left=(), middle=(), right=()):
    return Scene.of(left, middle, right)


@st.composite
def items(draw, overhang=0):
    """Items inside the box, or up to `overhang` pixels outside."""
    size = draw(st.sampled_from(Size))
    coordinate = st.integers(-overhang, BOX_SIDE - size.pixels + overhang)
    return Item(draw(coordinate), draw(coordinate), draw(st.sampled_from(Shape)), draw(st.sampled_from(Colour)), size)


@st.composite
def scatter_boxes(draw):
    """Boxes with non-overlapping items."""
    placed = []
    for item in draw(st.lists(items(), max_size=MAX_ITEMS)):
        if is_free(item.footprint, item.x, item.y, placed):
            placed.append(item)
    return Box(tuple(placed))


tower_boxes = st.lists(st.sampled_from(Colour), max_size=4).map(lambda colours: Box(tuple(tower(*colours))))
unchecked_boxes = st.lists(items(overhang=35), max_size=MAX_ITEMS).map(lambda unchecked: Box(tuple(unchecked)))


def _scenes(boxes):
    return st.tuples(boxes, boxes, boxes).map(Scene)


SCENES = {"tower": _scenes(tower_boxes), "scatter": _scenes(scatter_boxes())}  # the valid scenes of each appearance
UNCHECKED_SCENES = _scenes(unchecked_boxes)  # items may overlap and cross box walls


def items_apart(one, other):
    """The number of items that are in only one of the scenes."""
    pairs = zip(one.boxes, other.boxes, strict=True)
    return sum(len(set(a.items) ^ set(b.items)) for a, b in pairs)
