"""`scripts/measure_messages.py`: how much of the proposals the messages tell."""

import numpy as np
import pytest

from tests.scripts import load_script


@pytest.mark.parametrize(
    ("counts", "information"),
    [
        (np.eye(4), (2.0, 2.0)),  # each message names its proposal
        (np.ones((4, 4)), (0.0, 2.0)),  # proposals do not depend on messages
        ([[5, 0, 0, 0]] * 4, (0.0, 0.0)),
        ([[1, 1, 0, 0], [0, 0, 1, 1]], (1.0, 2.0)),  # messages name halves of the proposals
    ],
)
@pytest.mark.long
def test_information__is_what_messages_tell_of_proposals_and_their_entropy(counts, information):
    heard = load_script("measure_messages").Listening(None, *np.shape(counts))
    heard.counts += counts
    assert heard.information == pytest.approx(information)
