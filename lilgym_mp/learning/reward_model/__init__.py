"""A reward model of statements, learnt from the outcomes of STOPs, and search for scenes where it is sure."""
