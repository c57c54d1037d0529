"""Parse and plan: a small learned parser from statements to programs, and plans for its likely programs."""
