"""Downloads from servers of tests/stress/hostile_servers.py end quickly with one clear error."""

from __future__ import annotations

import pytest

from tests.stress.hostile_servers import MAX_SECONDS, SERVERS, outcome

TOO_SLOW = "not complete after 0.6 seconds (tries: 1; http://"
MESSAGES = {
    "drips a body": TOO_SLOW,
    "drips headers": TOO_SLOW,
    "drips chunk extensions": TOO_SLOW,
    "a length in superscript digits": "invalid literal for int()",
    "a negative length": "success",
    "a first answer of 206": "the server answers 206 P",
    "an invalid pause": "503 Server Error: S",
    "a status with escape codes": r"the server answers 404 \x1b[31mred\x07",
    "a redirect to ftp": "No connection adapters were found for 'ftp://127.0.0.1/file'",
    "an empty redirect": "the server answers 302",
}


@pytest.mark.long
@pytest.mark.parametrize("name", SERVERS)
def test_hostile_servers__cause_one_printable_error_line_quickly(name: str) -> None:
    message, seconds = outcome(name)
    assert seconds < MAX_SECONDS
    assert MESSAGES.get(name, "") in message
    assert (message == "success") == (MESSAGES.get(name) == "success")
    assert message.isprintable()
