"""The words of the program language, for the editor's completions and list, from the language's own tables."""

from __future__ import annotations

import inspect
from functools import cache

from lilgym_mp.contrib.web.bodies import JSON, pick
from lilgym_mp.programs.syntax import ATTRIBUTES, METHODS
from lilgym_mp.programs.values import ENUMS, BoxView
from lilgym_mp.programs.words import GROUPS, WORDS

# What is no function, by group: name and meaning.
OTHERS = {
    "scene": {"all_boxes": "The three boxes, left to right.", "all_items": "Every item of the scene, box by box."},
    "values": {f"{name}.{each.name}": f"A member of {name}." for name, members in ENUMS.items() for each in members},
    "members": {f".{name}": f"The item's {name}." for name in ATTRIBUTES}
    | {f".{name}()": inspect.getdoc(getattr(BoxView, name)) or "" for name in METHODS},
    "Python": dict.fromkeys(("lambda", "and", "or", "not", "in", "True", "False"), "As in Python."),
}


@cache
def language() -> JSON:
    """All words with their group, signature and meaning."""
    words = [{**pick(word, "name", "group", "signature", "meaning"), "is_function": True} for word in WORDS.values()]
    for group, others in OTHERS.items():
        for name, meaning in others.items():
            words.append({"name": name, "group": group, "signature": name, "meaning": meaning, "is_function": False})
    for word in words:
        word["meaning"] = " ".join(word["meaning"].replace("`", "").split())
    return {"groups": [*GROUPS, *OTHERS], "words": words}
