"""Adapters to libraries that train and evaluate language models. Each imports its library; see the extras."""
