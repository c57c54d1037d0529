"""What is built on the environments and agents: web pages, the report, language models. Nothing else imports it."""
