"""/sentence: readings, doubts and plans of typed sentences."""

import pytest

pytest.importorskip("torch")


def read(browser, sentence, target=True):
    return browser.post("/api/sentence", {"sentence": sentence, "target": target}).json()


def test_sentence__the_pages_first_example_has_a_plan_for_its_first_reading(browser):
    answer = read(browser, "There is a tower with a blue block on top.")
    assert len(answer["steps"]) == 2
    assert (answer["readings"][0]["satisfied"], answer["uncertain"]) == (True, [])


def test_sentence__doubts_are_in_the_answer_and_among_its_notes(browser):
    answer = read(browser, "There are 2.5 blue blocks.")
    assert "'2.5' cannot be read" in answer["uncertain"][0]
    assert f"Unsure: {answer['uncertain'][0]}." in answer["notes"]


def test_sentence__of_none_of_our_words_has_no_readings(browser):
    answer = read(browser, "asdf qwerty", target=False)
    assert (answer["understood"], answer["readings"], len(answer["steps"])) == (False, [], 1)
