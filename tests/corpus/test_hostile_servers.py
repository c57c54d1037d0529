"""The servers of checks/hostile_servers.py, some of them: every download ends soon with one clear error."""

from __future__ import annotations

import pytest

from checks.hostile_servers import SECONDS, outcome

TOO_SLOW = "the server sends too slowly (asked 3 times for http://"
SAID = {
    "drips a body": TOO_SLOW,
    "drips headers": TOO_SLOW,
    "drips chunk extensions": TOO_SLOW,
    "a length of other digits": "success",
    "a first answer of 206": "the server answered from byte 5, not 0",
    "a first answer of 416": "the server has fewer bytes than were downloaded before",
    "an odd pause": "answers 503 S (asked 3 times",
    "a status of colours": r"the server answers 404 \x1b[31mred\x07",
    "a redirect to ftp": "cannot download from 'ftp://127.0.0.1/file'; a URL starts with http:// or https://",
    "a redirect to half an address": "no proper answer: Invalid IPv6 URL",
    "a redirect to a long name": "no proper answer: ",
}


@pytest.mark.long
@pytest.mark.parametrize("name", SAID)
def test_hostile_servers__are_given_up_soon_in_one_printable_line(name: str) -> None:
    said, seconds = outcome(name, text=False)
    assert seconds < SECONDS
    assert SAID[name] in said
    assert said.isprintable()


@pytest.mark.long
def test_hostile_servers__a_text_that_drips_is_given_up_too() -> None:
    said, seconds = outcome("drips a body of unknown length", text=True)
    assert seconds < SECONDS
    assert TOO_SLOW in said
