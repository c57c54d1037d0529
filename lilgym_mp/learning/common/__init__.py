"""What several learners share; each learner imports this package and no other learner."""
