"""Statements from meanings, one module for each stage.

`sampling` draws a meaning (`semantics`) of some difficulty level; `program_realisation` and `sentence_realisation` turn
it into a program and an English statement; `statement_grammar` parses the statement back, and `validation` keeps it
only if every parse, evaluated by `interpretation`, agrees with the program on scenes of a pool (`scene_sampling`);
`start_selection` selects start scenes; `generated_corpus` makes task sets of the results.
"""
