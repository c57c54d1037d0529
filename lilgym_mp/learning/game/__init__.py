"""Learning both sides of the proposer-verifier game, on the update of `learning.ppo`."""
