"""Tower: stacks of blocks, of which edits add and remove the top one."""
