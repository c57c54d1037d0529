"""Statements from synchronous templates, whose parts each have words and program text.

`phrases` has quantities, noun phrases and predicates, `conditions` the conditions of boxes, `items` and `boxes`
statements, `tower` and `scatter` those of one appearance.
"""
