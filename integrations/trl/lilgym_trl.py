"""The adapter of `lilgym_mp.contrib.adapters.trl`, under its old name."""

from lilgym_mp.contrib.adapters.trl import PlanEnvironment, main, stream, verified_reward

__all__ = ["PlanEnvironment", "main", "stream", "verified_reward"]

if __name__ == "__main__":
    main()
