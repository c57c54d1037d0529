"""The script that audits reward models."""

import numpy as np

from tests.scripts import load_script

audit_script = load_script("audit_reward_model")


def test_audit__tells_calibration_and_soundness_of_each_verifier(capsys):
    right = np.array([[True, True, False, False], [True, False, True, True]])
    judged = np.array([[[0.9, 0.8, 0.8, 0.3], [0.9, 0.2, 0.1, 0.6]], [[0.2, 0.7, 0.9, 0.9], [0.6, 0.95, 0.6, 0.8]]])
    targets = np.array([True, True, False, False])
    audit_script.audit(audit_script.Claims(right, judged, targets), ["a", "b"])
    lines = filter(None, capsys.readouterr().out.splitlines())
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert ["a", "50.0", "100.0", "0.0", "70.0"] in rows
    assert ["0.7 to 0.9", "3", "80.0", "66.7"] in rows  # 0.8 and 0.8 of a, right and wrong, and 0.8 of b, right
    assert ["a", "a", "75.0", "100.0", "50.0", "66.7"] in rows
    assert ["a", "b", "50.0", "50.0", "50.0", "50.0"] in rows
