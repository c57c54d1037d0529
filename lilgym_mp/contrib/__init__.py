"""What is built on the environments and agents: web pages, the report, language models. Nothing else imports it."""

from lilgym_mp.submodules import submodule_getter

__getattr__ = submodule_getter(__name__)
