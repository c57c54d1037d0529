"""Generated code for programs, which makes the core fast. The core plays without it."""
