"""The networks that PPO trains, behind one protocol: states in, a policy over actions and values out."""
