"""Pictures of how good a study's fits are: verdicts on parameters, ends of starts."""
