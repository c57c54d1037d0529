"""What makes the core fast: generated code for programs. The core plays without it."""
