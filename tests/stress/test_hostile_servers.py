"""Downloads from servers of tests/stress/hostile_servers.py end quickly with one clear error."""

from __future__ import annotations

import pytest

from tests.stress.hostile_servers import MAX_SECONDS, outcome

TOO_SLOW = "the server sends too slowly (tried 3 times: http://"
MESSAGES = {
    "drips a body": TOO_SLOW,
    "drips headers": TOO_SLOW,
    "drips chunk extensions": TOO_SLOW,
    "a length in superscript digits": "success",
    "a first answer of 206": "the server answered from byte 5, not 0",
    "a first answer of 416": "the server has fewer bytes than were downloaded before",
    "an invalid pause": "answers 503 S (tried 3 times",
    "a status with escape codes": r"the server answers 404 \x1b[31mred\x07",
    "a redirect to ftp": "cannot download from 'ftp://127.0.0.1/file'; a URL must start with http:// or https://",
    "a redirect to an invalid address": "invalid response: Invalid IPv6 URL",
    "a redirect to a long name": "invalid response: ",
}


@pytest.mark.long
@pytest.mark.parametrize("name", MESSAGES)
def test_hostile_servers__cause_one_printable_error_line_quickly(name: str) -> None:
    message, seconds = outcome(name, text=False)
    assert seconds < MAX_SECONDS
    assert MESSAGES[name] in message
    assert message.isprintable()


@pytest.mark.long
def test_hostile_servers__a_slow_text_response_is_an_error() -> None:
    message, seconds = outcome("drips a body of unknown length", text=True)
    assert seconds < MAX_SECONDS
    assert TOO_SLOW in message
