"""Statistics of corpora: phenomena in statements and programs, counts, charts."""
